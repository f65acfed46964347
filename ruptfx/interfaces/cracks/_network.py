"""Inner facets of a mesh of triangles: cells on their sides, geometry, and an order independent of the partition."""

from __future__ import annotations

from functools import cached_property
from math import fsum
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.meshes import FACETS
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.bodies import Bodies


class CrackNetwork:
    """Facets between two triangles, with at least one triangle of this rank, or with a vertex of one.

    Parameters
    ----------
    space : FunctionSpace
        Broken Lagrange space of order 1.
    whole_stars : bool
        Whether to include all facets at the vertices of own cells, or only those of own cells.

    Attributes
    ----------
    vertices : ndarray of int, shape (facets, 2)
        Numbers of the ends in the input, the lower first. Facets are sorted by them: the same order on all
        ranks, in which forces are added up.
    cells : ndarray of int, shape (facets, 2)
        Local cells on the minus and on the plus side; minus has the lower number in the input.
    corners : ndarray of int32, shape (facets, 2, 2)
        Local nodes by side and end.
    normal : ndarray, shape (facets, 2)
        Unit normal from minus to plus; the tangent is (n_y, -n_x), as at all interfaces.
    ends : ndarray, shape (facets, 2, 2)
        Coordinates of the ends [m].
    length : ndarray, shape (facets,)
        [m]; either end stands for half of it.
    bodies : ndarray of int, shape (facets, 2)
        Body on each side.
    open : ndarray of bool, shape (facets,)
        True for initial cracks.
    joint : ndarray of int, shape (facets,)
        Number of the joint that a facet belongs to, in their order in the mesh; -1 for none.
    owned : ndarray of bool, shape (facets,)
        True on one rank: the one that owns the minus cell.
    area : float
        Area of all bodies [m2], bitwise the same on any number of ranks.
    cell_vertices : ndarray of int, shape (local cells, 3)
        Vertices of all cells by their numbers in the input; first those of the `owned_cells`.
    cell_numbers : ndarray of int, shape (local cells,)
        Numbers of the cells in the input.
    owned_cells : int
    """

    def __init__(
        self, space: fem.dolfinx.fem.FunctionSpace[np.float64], bodies: Bodies, whole_stars: bool = False
    ) -> None:
        mesh = space.mesh
        self.comm = mesh.comm
        index_map = mesh.topology.index_map(2)
        owned, count = index_map.size_local, index_map.size_local + index_map.num_ghosts
        geometry = fem.geometry_dofmap(mesh)[:count]
        inputs = mesh.geometry.input_global_indices[geometry]
        x = mesh.geometry.x[:, :2][geometry]
        number = np.asarray(mesh.topology.original_cell_index)[:count]

        self.cell_vertices, self.cell_numbers, self.owned_cells = inputs, number, owned

        places = np.array(FACETS["triangle"])  # corners of the three facets of a cell
        cell, corner = np.repeat(np.arange(count), 3), np.tile(places, (count, 1))
        vertices = inputs[cell[:, None], corner]
        turned = vertices[:, 0] > vertices[:, 1]
        vertices[turned], corner[turned] = vertices[turned, ::-1], corner[turned, ::-1]
        order = np.lexsort([number[cell], vertices[:, 1], vertices[:, 0]])
        cell, corner, vertices = cell[order], corner[order], vertices[order]
        first = np.flatnonzero(np.all(vertices[1:] == vertices[:-1], axis=1))
        known_here = (cell[first] < owned) | (cell[first + 1] < owned)
        if whole_stars:
            known_here |= np.isin(vertices[first], inputs[:owned]).any(axis=1)
        first = first[known_here]
        both = np.stack([first, first + 1], axis=1)

        self.vertices, self.cells = vertices[first], cell[both]
        self.corners = space.dofmap.list[self.cells[:, :, None], corner[both]]
        self.ends = x[cell[first, None], corner[first]]
        self.owned = self.cells[:, 0] < owned
        self.bodies = bodies.cell_body[self.cells]
        known = {tuple(facet) for facet in bodies.open_facets.tolist()}
        self.open = np.array([tuple(facet) in known for facet in self.vertices.tolist()], dtype=bool)
        joints = {tuple(f): i for i, facets in enumerate(bodies.joints.values()) for f in facets.tolist()}
        self.joint = np.array([joints.get(tuple(facet), -1) for facet in self.vertices.tolist()], dtype=int)
        along = self.ends[:, 1] - self.ends[:, 0]
        self.length = np.hypot(along[:, 0], along[:, 1])
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / self.length[:, None]
        opposite = x[cell[first], 3 - corner[first].sum(axis=1)] - self.ends[:, 0]
        inward = normal[:, 0] * opposite[:, 0] + normal[:, 1] * opposite[:, 1] > 0
        self.normal = np.where(inward[:, None], -normal, normal)
        side = x[:owned, 1:] - x[:owned, :1]
        self.area = self.total(0.5 * np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]))

    def total(self, values: np.ndarray) -> float:
        """Return the exact sum over all ranks, independent of the order; collective."""
        rows = parallel.gather_rows(self.comm, values)
        return float(self.comm.bcast(None if rows is None else fsum(rows), root=0))

    def pairs(self) -> np.ndarray:
        """Return the numbers of the bodies on both sides of facets, each pair once, shape (pairs, 2); collective."""
        own_pairs = np.unique(np.sort(self.bodies[self.owned], axis=1), axis=0)
        return np.unique(parallel.share_rows(self.comm, own_pairs), axis=0)

    def gather(self, columns: np.ndarray) -> np.ndarray | None:
        """Return rows of all owned facets in the order of all ranks on rank 0, None elsewhere; collective.

        Parameters
        ----------
        columns : ndarray, shape (facets, ...)
        """
        rows = columns.reshape(len(self.owned), -1)[self.owned]
        gathered = parallel.gather_rows(self.comm, np.column_stack([self.number[self.owned].astype(float), rows]))
        if gathered is None:
            return None
        return np.asarray(gathered[np.argsort(gathered[:, 0]), 1:].reshape(-1, *columns.shape[1:]))

    @cached_property
    def number(self) -> np.ndarray:
        """Return the index of every facet in the order of all ranks, shape (facets,); collective at its first use."""
        everything = parallel.share_rows(self.comm, self.vertices[self.owned])
        scale = int(everything.max(initial=0)) + 1
        return np.asarray(np.searchsorted(np.sort(everything @ [scale, 1]), self.vertices @ [scale, 1]))
