"""Bodies as a distributed mesh: partition with interface pairs on one rank, named facets, body of each cell."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, Base, MeshSource, RawMesh
from ruptfx.bodies.meshes.strip import Strip
from ruptfx.bodies.space.branches import weld_branch_ends
from ruptfx.bodies.space.closest import closest
from ruptfx.bodies.space.connections import check_connections
from ruptfx.input.schema import nearest
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.meshes import AnyLattice

Facets = tuple[np.ndarray, np.ndarray]  # facets of both sides, vertex by vertex
VERTICES = {cell: 1 + max(max(facet) for facet in facets) for cell, facets in FACETS.items()}
CHUNK = 1000  # cells checked at a time, which limits temporary memory


@dataclass(frozen=True)
class Tie:
    """Two edges whose nodes move alike.

    Attributes
    ----------
    key : str
        Of the case, for messages.
    first, second : str
    shift : ndarray, shape (dim,)
        Vector from the first to the second edge [m].
    """

    key: str
    first: str
    second: str
    shift: np.ndarray


@dataclass(frozen=True)
class Bodies:
    """Distributed mesh of all bodies.

    Attributes
    ----------
    mesh : dolfinx.mesh.Mesh
    names : list of str
        Names of the bodies.
    cell_body : ndarray of int32, shape (local cells,)
        Index into `names`, ghost cells included.
    facets : MeshTags
        Tags of all named facets.
    tags : dict of str to int
        Facet tag of an edge ``"upper.left"`` or of an interface side ``"main.plus"``.
    interfaces : list of str
    one_sided : dict of str to str
        As in `RawMesh`.
    ties : list of Tie
    surfaces : dict of str to (ndarray, ndarray)
        Facets of the plus and the minus side of interfaces with finite sliding, by vertices of the raw mesh.
    bases : dict of str to Base
        As in `RawMesh`.
    open_facets : ndarray of int, shape (facets, 2)
        Initial cracks, by vertices of the raw mesh.
    joints : dict of str to ndarray of int, shape (facets, 2)
        Named inner facets, by vertices of the raw mesh.
    reference_normals : dict of str to ndarray, shape (3,)
        As in `RawMesh`.
    mirror_planes : dict of str to str
        As in `RawMesh`.
    strike : int or None
        As in `RawMesh`.
    """

    mesh: fem.dolfinx.mesh.Mesh
    names: list[str]
    cell_body: np.ndarray
    facets: fem.dolfinx.mesh.MeshTags
    tags: dict[str, int]
    interfaces: list[str]
    one_sided: dict[str, str]
    ties: list[Tie] = field(default_factory=list)
    surfaces: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    bases: dict[str, Base] = field(default_factory=dict)
    open_facets: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    joints: dict[str, np.ndarray] = field(default_factory=dict)
    reference_normals: dict[str, np.ndarray] = field(default_factory=dict)
    mirror_planes: dict[str, str] = field(default_factory=dict)
    strike: int | None = None

    @property
    def edges(self) -> list[str]:
        """Names of the edges."""
        return [name for name in self.tags if name.rpartition(".")[2] not in ("plus", "minus")]

    def tag(self, edge: str, key: str) -> int:
        """Return the tag of a named edge.

        Raises
        ------
        RuptfxError
            If there is no such edge; the message lists the names.
        """
        if edge not in self.edges:
            number = next((name for name in self.edges if name.isdecimal()), "")
            hint = f'; in [mesh], names = {{ "{edge}" = {number} }} gives a name to group {number}' if number else ""
            raise RuptfxError(f"{key} = '{edge}': no such edge, {nearest(edge, self.edges)}{hint}")
        return self.tags[edge]


def distribute(
    comm: fem.MPI.Comm, source: MeshSource | Strip, tied: Mapping[str, tuple[str, str]] | None = None,
    sliding: Collection[str] = (), neighbours: bool = False,
) -> Bodies:  # fmt: skip
    """Return the mesh, split over the ranks.

    Both sides of every interface point are on the same rank, also those of tied edges.

    Parameters
    ----------
    comm : MPI communicator
    tied : dict of str to (str, str), optional
        Edges whose nodes move alike, by key of the case.
    sliding : collection of str
        Interfaces with finite sliding.
    neighbours : bool
        Whether ranks know all cells that share a vertex with one of theirs.

    Raises
    ------
    RuptfxError
        On all ranks.
    """
    lattice = source.lattice()
    ordinary = not sliding and not neighbours
    if lattice is not None and ordinary and has_parts(lattice, comm.size):
        shifts = lattice.ties(tied or {})
        if shifts is not None:
            ties = [Tie(key, *edges, shifts[key]) for key, edges in (tied or {}).items()]
            return _from_parts(comm, lattice, ties)
    return _from_root(comm, source, tied or {}, sliding, neighbours)


def has_parts(lattice: AnyLattice, parts: int) -> bool:
    """Return whether every part has two columns at least; fewer are not worth it."""
    blocks = range(1, min(parts, lattice.most_blocks) + 1)
    return any(parts % along == 0 and 2 * (parts // along) <= lattice.columns for along in blocks)


def _from_parts(comm: fem.MPI.Comm, lattice: AnyLattice, ties: list[Tie]) -> Bodies:
    """Return the mesh of a lattice: every rank makes its own cells, and an equal share of the vertices.

    There are no ghost cells: a rank with a vertex of an interface owns one of the pairs there.
    """
    along = {tie.first.rpartition(".")[2] for tie in ties}
    cells = lattice.part(comm.rank, comm.size, bool(along & {"left", "right"}), bool(along & {"top", "bottom"}))
    first, last = lattice.vertices * np.array([comm.rank, comm.rank + 1]) // comm.size
    points = lattice.points(np.arange(first, last))

    def partitioner(*_: object) -> object:
        return _destinations(np.full(len(cells), comm.rank, np.int32), np.arange(len(cells) + 1, dtype=np.int32))

    mesh = fem.create_mesh(comm, cells.astype(np.int64), points, lattice.cell, partitioner)
    facets, tags = _tag_facets(mesh, list(lattice.sides), lattice.side_of)
    tags |= {f"{name}.minus": tags[f"{name}.plus"] for name in lattice.one_sided}
    body = lattice.body_of_cells(mesh.geometry.input_global_indices[fem.geometry_dofmap(mesh)])
    interfaces = [*lattice.interfaces, *lattice.one_sided]
    return Bodies(
        mesh, lattice.bodies, body.astype(np.int32), facets, tags, interfaces, lattice.one_sided, ties,
        reference_normals=lattice.reference_normals, mirror_planes=lattice.mirror_planes,
    )  # fmt: skip


def _from_root(
    comm: fem.MPI.Comm, source: MeshSource | Strip, tied: Mapping[str, tuple[str, str]], sliding: Collection[str],
    neighbours: bool,
) -> Bodies:  # fmt: skip
    """Build the mesh on rank 0 and split it so that pairs of interface points stay together.

    The dual graph is partitioned with the two sides of interfaces glued together, the minus cell of every pair follows
    the plus cell, and a pair is a ghost wherever a rank touches one of its vertices without owning it. Tied edges are
    treated in the same way. In finite sliding, every rank that owns a cell at the interface has all the others as
    ghosts.
    """
    raw: RawMesh | None = None
    error: Exception | None = None
    pairs: dict[str, Facets] = {}
    if comm.rank == 0:
        try:
            raw = source.build()
            check_orientation(raw)
            check_facets(raw)
            raw = weld_branch_ends(raw, sliding)
            check_pairs(raw, sliding)
            pairs = {key: tied_facets(raw, key, *edges) for key, edges in tied.items()}
            if not neighbours:  # fragments may fly
                check_connections(raw, pairs.values())
        except Exception as caught:
            error = caught
    parallel.raise_on_all(comm, error)
    described = None
    if raw is not None:
        named = named_facets(raw)
        faces = list(raw.interfaces)
        ties = [
            Tie(key, *tied[key], (raw.points[b] - raw.points[a]).mean(axis=(0, 1))) for key, (a, b) in pairs.items()
        ]
        surfaces = {name: sides for name, sides in raw.interfaces.items() if name in sliding}
        described = (
            raw.cell, raw.points.shape[1], raw.cells.shape[1], raw.order, raw.bodies, raw.cell_body, faces,
            raw.one_sided, named, ties, surfaces, raw.bases, np.sort(raw.open_facets, axis=1),
            {name: np.sort(facets, axis=1) for name, facets in raw.joints.items()},
            raw.reference_normals, raw.mirror_planes, raw.strike,
        )  # fmt: skip
    described = comm.bcast(described, root=0)
    cell, dim, nodes, order, bodies, cell_body, interfaces, one_sided, named, ties, surfaces, bases, *inner = described

    split = np.zeros(0, np.int32), np.zeros(1, np.int32)
    if raw is not None:
        joined = list(pairs.values()), sliding, neighbours
        split = destinations(raw, comm.size, *joined)
        if not _all_have_cells(split, comm.size):
            fewer = ((parts, destinations(raw, parts, *joined)) for parts in range(comm.size - 1, 0, -1))
            works = next(parts for parts, each in fewer if _all_have_cells(each, parts))
            error = RuptfxError(
                f"{comm.size} ranks for {len(raw.cells)} elements, of which those at an interface stay in pairs: some "
                f"ranks would have none; use --ranks {works}, or smaller elements"
            )
    parallel.raise_on_all(comm, error)

    def partitioner(*_: object) -> object:
        return _destinations(*split)

    cells = raw.cells.astype(np.int64) if raw is not None else np.zeros((0, nodes), np.int64)
    points = raw.points if raw is not None else np.zeros((0, dim))
    mesh = fem.create_mesh(comm, cells, points, cell, partitioner, order)
    number = {
        tuple(facet): place for place, facets in enumerate(named.values())
        for facet in np.sort(facets, axis=1).tolist()
    }  # fmt: skip
    facets, tags = _tag_facets(
        mesh, list(named), lambda value: np.array([number.get(tuple(facet), -1) for facet in value.tolist()], dtype=int)
    )
    tags |= {f"{name}.minus": tags[f"{name}.plus"] for name in one_sided}
    cell_body = cell_body[mesh.topology.original_cell_index].astype(np.int32)
    return Bodies(mesh, bodies, cell_body, facets, tags, interfaces, one_sided, ties, surfaces, bases, *inner)


def _all_have_cells(split: tuple[np.ndarray, np.ndarray], parts: int) -> bool:
    """Return whether every part owns a cell, from data and offsets of `destinations`."""
    owners, offsets = split
    return len(np.unique(owners[offsets[:-1]])) == parts


def _destinations(data: np.ndarray, offsets: np.ndarray) -> object:
    """Return the ranks of every cell in the format of DOLFINx."""
    lists = fem.dolfinx.graph.adjacencylist(data, offsets)
    return getattr(lists, "_cpp_object", lists)


def check_orientation(raw: RawMesh) -> None:
    """Refuse flat or folded quadrilaterals and hexahedra, which would give negative masses."""
    if raw.cell == "hexahedron" or (raw.cell == "quadrilateral" and raw.order > 1):
        _check_curved(raw)
    if raw.cell != "quadrilateral" or raw.order > 1:
        return
    a, b, c, d = (raw.points[raw.cells[:, i]] for i in range(4))

    def cross(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]

    corners = np.stack([cross(b - a, c - a), cross(b - a, d - b), cross(d - c, c - a), cross(d - c, d - b)])
    bad = (corners.min(axis=0) <= 0) & (corners.max(axis=0) >= 0)
    if np.any(bad):
        x = raw.points[raw.cells[np.argmax(bad)]].mean(axis=0)
        raise RuptfxError(
            f"mesh: {bad.sum()} flat or folded quadrilaterals, the first near ({x[0]:.6g}, {x[1]:.6g}) m; mesh it "
            "again with smaller elements there, or with triangles"
        )


def _check_curved(raw: RawMesh) -> None:
    """Refuse curved cells whose map folds at a point that the kernels use."""
    basix = fem.basix
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType[raw.cell], raw.order, lagrange_variant=basix.LagrangeVariant.gll_warped
    )
    slopes = np.asarray(element.tabulate(1, np.asarray(element.points)))[1:, :, :, 0]
    lowest, highest = np.empty(len(raw.cells)), np.empty(len(raw.cells))
    for first in range(0, len(raw.cells), CHUNK):
        part = slice(first, first + CHUNK)
        volume = np.linalg.det(np.einsum("dqk,cka->cqda", slopes, raw.points[raw.cells[part]]))
        lowest[part], highest[part] = volume.min(axis=1), volume.max(axis=1)
    bad = lowest <= 0
    if np.any(bad & (highest > 0)):
        bad &= highest > 0
        x = ", ".join(f"{value:.6g}" for value in raw.points[raw.cells[np.argmax(bad)]].mean(axis=0))
        raise RuptfxError(
            f"mesh: {bad.sum()} cells are folded, the first near ({x}) m: the surface is too steep "
            "or too high for them; reduce the heights of the profile, or make the body higher"
        )


def named_facets(raw: RawMesh) -> dict[str, np.ndarray]:
    """Facets of the edges and of the meshed sides of the interfaces, ``"main.plus"``, by local number."""
    sides = {
        f"{n}.{side}": f
        for n, pair in raw.interfaces.items()
        for side, f in zip(("plus", "minus"), pair, strict=True)
        if side == "plus" or n not in raw.one_sided
    }
    return raw.edges | sides


def check_facets(raw: RawMesh) -> None:
    """Refuse facets with two names, as a facet has one tag only."""
    named = {name: facets for name, facets in named_facets(raw).items() if len(facets)}
    if not named:
        return
    owner = np.repeat(np.arange(len(named)), [len(facets) for facets in named.values()])
    everything = np.concatenate(list(named.values()))
    _, label, count = np.unique(np.sort(everything, axis=1), axis=0, return_inverse=True, return_counts=True)
    twice = np.flatnonzero(count[label.ravel()] > 1)
    if len(twice):
        same = twice[label.ravel()[twice] == label.ravel()[twice[0]]]
        names = " and ".join(f"'{list(named)[i]}'" for i in owner[same])
        x = ", ".join(f"{value:.6g}" for value in raw.points[everything[twice[0]]].mean(axis=0))
        raise RuptfxError(f"mesh: the facet at ({x}) m belongs to {names}; name every facet once")


def check_pairs(raw: RawMesh, sliding: Collection[str] = ()) -> None:
    """Refuse interfaces that meet at points with more than two sides.

    A node must have one partner, else tractions are summed wrongly; nodes in finite sliding have none.
    """
    for name in raw.bases:
        if name not in sliding:
            raise RuptfxError(
                f"mesh.base: a block slides over the profile of its base; add the table [faults.{name}.sliding]"
            )
    for name in raw.non_matching:
        if name not in sliding:
            raise RuptfxError(
                f"mesh: the two sides of interface '{name}' have meshes of their own; add the table "
                f"[faults.{name}.sliding], or mesh both sides alike"
            )
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for name, (plus, minus) in raw.interfaces.items():
        if name not in raw.one_sided and name not in sliding:
            pairs.append(np.unique(np.stack([plus.ravel(), minus.ravel()], axis=1), axis=0))
    paired = [name for name in raw.interfaces if name not in raw.one_sided and name not in sliding]
    names = np.repeat(paired, [len(pair) for pair in pairs[1:]])
    sides = np.concatenate(pairs)
    _, first = np.unique(sides, axis=0, return_index=True)
    first = first[sides[first, 0] != sides[first, 1]]
    node, count = np.unique(sides[first], return_counts=True)
    if not np.any(count > 1):
        return
    bad = node[np.argmax(count)]
    there = first[(sides[first] == bad).any(axis=1)]
    turned = len({frozenset(pair) for pair in sides[there].tolist()}) == 1
    together = np.isin(sides, sides[there]).any(axis=1)
    meeting = " and ".join(f"'{name}'" for name in sorted(set(names[together].tolist())))
    x = ", ".join(f"{value:.6g}" for value in raw.points[bad])
    raise RuptfxError(
        f"mesh: interface {meeting} at ({x}) m: "
        + ("plus is there what is minus in the other; swap plus and minus of one of them" if turned else
           "more than two sides meet, and a point of an interface has two. An interface may end on another one that "
           "goes on there (a branch): where two cross, give the halves of one of them two names (mesh.interfaces); "
           "where three end, give two of them one name")
    )  # fmt: skip


def tied_facets(raw: RawMesh, key: str, first: str, second: str) -> Facets:
    """Return facets of two edges that differ by a shift only, in the same order, vertex by vertex.

    Raises
    ------
    RuptfxError
        If there is no such edge, or a vertex of the second has no partner.
    """
    for name, edge in (("first", first), ("second", second)):
        if edge not in raw.edges:
            raise RuptfxError(f"{key}.{name} = '{edge}': no such edge, {nearest(edge, list(raw.edges))}")
    here, there = (np.unique(raw.edges[edge]) for edge in (first, second))
    low, high = (np.stack([raw.points[nodes].min(axis=0), raw.points[nodes].max(axis=0)]) for nodes in (here, there))
    shift = (high - low).mean(axis=0)
    distance, partner = closest(raw.points[there] - shift, raw.points[here])
    lonely, extent = int(np.argmax(distance)), float(np.ptp(raw.points, axis=0).max())
    facets = here[partner][np.searchsorted(there, raw.edges[second])]
    same = {frozenset(facet) for facet in facets.tolist()} == {frozenset(f) for f in raw.edges[first].tolist()}
    if not np.any(shift) or distance[lonely] > 1e-8 * extent or len(here) != len(there) or not same:
        x = ", ".join(f"{value:.6g}" for value in raw.points[there[lonely]])
        raise RuptfxError(
            f"{key}: '{first}' ({len(here)} vertices) and '{second}' ({len(there)}) are not the same edge shifted by "
            f"({', '.join(f'{value:.6g}' for value in shift)}) m: the vertex of '{second}' at ({x}) m is "
            f"{distance[lonely]:.3g} m from its nearest partner, at most {1e-8 * extent:.1g} m is allowed. Mesh both "
            "edges alike; in Gmsh with 'Periodic Curve {...} = {...} Translate {...};' (in 3D 'Periodic Surface')"
        )
    return facets, raw.edges[second]


def destinations(
    raw: RawMesh, parts: int, tied: Sequence[Facets] = (), sliding: Collection[str] = (), neighbours: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return owner and ghost ranks of every cell: data and offsets of an adjacency list."""
    from scipy import sparse  # imported late: lattices do not need it
    from scipy.sparse.csgraph import connected_components

    count = len(raw.cells)
    if parts == 1:
        return np.zeros(count, np.int32), np.arange(count + 1, dtype=np.int32)
    joined = [*(sides for name, sides in raw.interfaces.items() if name not in sliding), *tied]
    glued = np.arange(len(raw.points))
    for plus, minus in joined:
        glued[minus] = plus
    while np.any(glued[glued] != glued):  # chains, for example a corner of tied edges at an interface
        glued = glued[glued]
    cells = glued[raw.cells[:, : VERTICES[raw.cell]]]
    owner = _partition_graph(raw.cell, cells, parts)
    facet_cell = _cell_of_facets(raw)
    pairs = []
    for plus, minus in joined:
        pairs.append(np.stack([facet_cell(plus), facet_cell(minus)], axis=1))
    ghosts: dict[int, set[int]] = defaultdict(set)
    if pairs:
        together = np.concatenate(pairs)
        # A cell may belong to several pairs: connected pairs all follow the plus cell of the first.
        links = sparse.coo_matrix((np.ones(len(together)), together.T), shape=(len(cells),) * 2)
        _, group = connected_components(links, directed=False)
        leader = np.empty(len(cells), dtype=np.int64)
        leader[group[together[::-1, 0]]] = together[::-1, 0]
        owner[together] = owner[leader[group[together]]]
        facets, others = (np.concatenate([sides[i] for sides in joined]) for i in (0, 1))
        # At the end of a branch its sides share a node, and only pairs of the main interface matter.
        split = np.zeros(len(raw.points), dtype=bool)
        split[glued[facets[facets != others]]] = True
        ignored = split[glued[facets]] & (facets == others)
        _ghost_pairs(cells, owner, np.where(ignored, -1, glued[facets]), together, group, ghosts)
    for name in sliding:
        both = np.concatenate([facet_cell(side) for side in raw.interfaces.get(name, ())])
        ranks = set(owner[both].tolist())
        for cell in both.tolist():
            ghosts[cell] |= ranks
    if neighbours:
        touching = np.zeros((len(raw.points), parts), dtype=bool)
        touching[cells, owner[:, None]] = True
        around = touching[cells].any(axis=1)
        for cell in np.flatnonzero(around.sum(axis=1) > 1).tolist():
            ghosts[cell] |= set(np.flatnonzero(around[cell]).tolist())
    lists = [[rank, *sorted(ghosts[cell] - {rank})] if cell in ghosts else [rank] for cell, rank in enumerate(owner)]
    offsets = np.concatenate([[0], np.cumsum([len(item) for item in lists])])
    return np.concatenate(lists).astype(np.int32), offsets.astype(np.int32)


def _partition_graph(cell: str, cells: np.ndarray, parts: int) -> np.ndarray:
    """Return the owner of every cell from a graph partitioner on the dual graph of the glued mesh."""
    from scipy import sparse

    count = len(cells)
    facets = np.concatenate([np.sort(cells[:, list(facet)], axis=1) for facet in FACETS[cell]])
    _, label = np.unique(facets, axis=0, return_inverse=True)
    incidence = sparse.csr_matrix(
        (np.ones(len(facets), np.int8), (np.tile(np.arange(count), len(FACETS[cell])), label.ravel()))
    )
    dual = (incidence @ incidence.T).tocsr()
    dual.setdiag(0)
    dual.eliminate_zeros()
    graph = fem.dolfinx.graph.adjacencylist(dual.indices.astype(np.int64), dual.indptr.astype(np.int32))
    split = fem.dolfinx.graph.partitioner()
    return np.array(split(fem.MPI.COMM_SELF, parts, getattr(graph, "_cpp_object", graph), False).array[:count])


def _cell_of_facets(raw: RawMesh) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from facets (by vertices) to their cells."""
    from scipy import sparse

    sorted_cells = raw.cells[:, : VERTICES[raw.cell]]
    touching = sparse.csr_matrix(
        (
            np.ones(sorted_cells.size, np.int16),
            (np.repeat(np.arange(len(sorted_cells)), sorted_cells.shape[1]), sorted_cells.ravel()),
        ),
        shape=(len(sorted_cells), len(raw.points)),
    )

    def find(facets: np.ndarray) -> np.ndarray:
        rows = np.repeat(np.arange(len(facets)), facets.shape[1])
        chosen = sparse.csr_matrix(
            (np.ones(facets.size, np.int16), (rows, facets.ravel())), shape=(len(facets), len(raw.points))
        )
        shared = (chosen @ touching.T).tocsr()
        full = shared.multiply(shared == facets.shape[1]).tocoo()
        cell = np.full(len(facets), -1)
        cell[full.row] = full.col
        return cell

    return find


def _ghost_pairs(
    cells: np.ndarray, owner: np.ndarray, facets: np.ndarray, pairs: np.ndarray, group: np.ndarray,
    ghosts: dict[int, set[int]],
) -> None:  # fmt: skip
    """Make a pair a ghost on every rank that has a vertex of the interface and owns none of the pairs there.

    Connected pairs become ghosts together. Facets have -1 for a vertex at which their pair does not matter.
    """
    on_interface = np.zeros(cells.max() + 1, dtype=bool)
    on_interface[facets[facets >= 0]] = True
    touching: dict[int, set[int]] = defaultdict(set)
    rows, columns = np.nonzero(on_interface[cells])
    for vertex, rank in zip(cells[rows, columns].tolist(), owner[rows].tolist(), strict=True):
        touching[vertex].add(rank)
    pairs_at: dict[int, list[int]] = defaultdict(list)
    for pair, facet in enumerate(facets.tolist()):
        for vertex in facet:
            pairs_at[vertex].append(pair)  # no rank touches a vertex -1
    members: dict[int, set[int]] = defaultdict(set)
    for cell in pairs.ravel().tolist():
        members[int(group[cell])].add(cell)
    for vertex, ranks in touching.items():
        holders = {int(owner[pairs[pair, 0]]) for pair in pairs_at[vertex]}
        for rank in ranks - holders:
            for cell in members[int(group[pairs[pairs_at[vertex][0], 0]])]:
                ghosts[cell].add(rank)


def _tag_facets(
    mesh: fem.dolfinx.mesh.Mesh, names: list[str], find: Callable[[np.ndarray], np.ndarray]
) -> tuple[fem.dolfinx.mesh.MeshTags, dict[str, int]]:
    """Return mesh tags of the named facets over which this rank integrates.

    Parameters
    ----------
    find : callable
        Function from boundary facets, as sorted input indices of their vertices, to the indices of their
        names, -1 for unnamed ones.
    """
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, dim)
    exterior = fem.dolfinx.mesh.exterior_facet_indices(mesh.topology)
    nodes = fem.corners_of_facets(mesh, exterior, len(FACETS[mesh.basix_cell().name][0]))
    inputs = np.sort(mesh.geometry.input_global_indices[nodes], axis=1)
    values = 1 + find(inputs).astype(np.int32)
    keep = values > 0
    order = np.argsort(exterior[keep])
    tags = {name: number + 1 for number, name in enumerate(names)}
    return fem.dolfinx.mesh.meshtags(mesh, dim - 1, exterior[keep][order], values[keep][order]), tags
