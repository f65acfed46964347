"""Numbers of nodes in the order in which explicit steps complete them, so that a step reads and writes memory in a row.

DOLFINx numbers the nodes of a mesh front by front. A front of a large mesh in 3D does not fit into the second-level
cache, and the nodes that a block of elements completes lie apart. Numbered block by block they are one range.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ruptfx.platform import fem

# Nodes computed between updates in 3D, and those of a tile. Measured with 3 million nodes, order 2 to 6: both have a
# flat optimum.
BLOCK_NODES_3D, TILE_NODES = 8192, 50_000
MOST_LANES = 16  # elements of a batch of single precision; blocks of both precisions have the same elements


def shared_nodes(index_map: fem.dolfinx.common.IndexMap) -> np.ndarray:
    """Return True for every local node shared with another rank; collective."""
    flag = fem.dolfinx.la.vector(index_map, 1)
    flag.array[:] = 0
    flag.array[index_map.size_local :] = 1
    flag.scatter_reverse(fem.dolfinx.la.InsertMode.add)
    flag.scatter_forward()
    return flag.array > 0


def has_tiles(space: fem.dolfinx.fem.FunctionSpace) -> bool:
    """Return whether the elements are computed tile by tile: hexahedra of order 2 and more.

    At order 1 the nodes of a tile would lie in too short rows; in 2D a front fits into the cache.
    """
    return space.mesh.basix_cell().name == "hexahedron" and space.element.basix_element.degree > 1


def tiles(space: fem.dolfinx.fem.FunctionSpace) -> np.ndarray:
    """Return the number of the tile that each element of this rank is in, shape (owned cells,)."""
    mesh, index_map = space.mesh, space.dofmap.index_map
    dim = mesh.topology.dim
    owned = mesh.topology.index_map(dim).size_local
    if not has_tiles(space) or not owned:
        return np.zeros(owned, dtype=np.int64)
    corner = mesh.geometry.x.min(axis=0)
    nodes = index_map.size_local + index_map.num_ghosts
    edge = (np.prod(np.ptp(mesh.geometry.x, axis=0)) * TILE_NODES / nodes) ** (1 / dim)
    middle = fem.dolfinx.mesh.compute_midpoints(mesh, dim, np.arange(owned, dtype=np.int32))
    along = ((middle - corner) / edge).astype(np.int64)
    return np.ravel_multi_index(tuple(along.T), tuple(along.max(axis=0) + 1))


def sweep_order(
    space: fem.dolfinx.fem.FunctionSpace, shared: np.ndarray, only: np.ndarray | None = None
) -> Iterator[np.ndarray]:
    """Yield the owned cells at nodes shared with other ranks, then the others, each in the order of a sweep.

    Parameters
    ----------
    shared : ndarray of bool, shape (nodes,)
    only : ndarray of bool, shape (cells,), optional
        True for local cells that count.
    """
    owned = space.mesh.topology.index_map(space.mesh.topology.dim).size_local
    dofmap, tile = space.dofmap.list[:owned], tiles(space)
    # The cells of a mesh have neighbours with near numbers, and these do not depend on those of the nodes.
    place = np.arange(owned) if has_tiles(space) else dofmap.min(axis=1)
    boundary = shared[dofmap].any(axis=1)
    counts = np.ones(owned, dtype=bool) if only is None else only[:owned]
    for group in (np.flatnonzero(boundary & counts), np.flatnonzero(~boundary & counts)):
        yield group[np.lexsort((place[group], tile[group]))]


def batches_of_block(nodes: int, cell_nodes: int, lanes: int) -> int:
    """Return the batches between updates of about `nodes` nodes, whose elements do not depend on the lanes."""
    return max(1, max(1, nodes * 4 // (cell_nodes * MOST_LANES)) * MOST_LANES // lanes)


def in_sweep_order(space: fem.dolfinx.fem.FunctionSpace) -> fem.dolfinx.fem.FunctionSpace:
    """Return a Lagrange space whose owned nodes have the order in which a sweep over the elements completes them.

    Nodes shared with other ranks come first. Spaces without tiles are returned as they are. Collective.
    """
    if not has_tiles(space):
        return space
    index_map, permutation = space.dofmap.index_map, fem.tensor_order(space)
    owned, count = index_map.size_local, index_map.size_local + index_map.num_ghosts
    shared = shared_nodes(index_map)
    last, first, begun, blocks = np.full(count, -1), np.full(count, -1), 0, 0
    elements = batches_of_block(BLOCK_NODES_3D, len(permutation), MOST_LANES) * MOST_LANES
    groups = list(sweep_order(space, shared))
    for group in groups:  # later assignments win: the last block, and backwards the first place
        block = blocks + np.arange(len(group)) // elements
        last[space.dofmap.list[group].ravel()] = np.repeat(block, len(permutation))
        blocks += -(-len(group) // elements)
    for group in reversed(groups):
        nodes = space.dofmap.list[group][:, permutation].ravel()
        first[nodes[::-1]] = np.arange(begun, begun - len(nodes), -1)
        begun -= len(nodes)
    last[shared] = -1
    sequence = np.lexsort((first[:owned], last[:owned]))
    number = np.arange(count, dtype=np.int32)
    number[sequence] = np.arange(owned, dtype=np.int32)
    return fem.renumbered(space, number)
