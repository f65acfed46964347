"""The jump of an interface with finite sliding, and its exact transpose.

Points are the nodes of the plus side; the mortar pairing (`ruptfx.interfaces.sliding.mortar`) gives each a weighted
mean of nodes of the minus side. Surfaces are lines in the plane and, in solids, sides of hexahedra. The jump is affine
in the displacement,

    [u] = offset + frame (u+ - B u-),

with an offset that makes the normal part the gap between the present surfaces, and that keeps the
tangential part continuous when B and the frames change: sticking points remain stuck, and slip accumulates.

Normals are those of the minus side. The tangents of a point in a solid are fixed directions, the tangents of the mean
normal before anything moves, rotated with the normal: frames follow from the present displacement alone.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, Base
from ruptfx.bodies.meshes.lobatto import nodes_between
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.interfaces.faults.interface import Interface, Line, local_frame, order_points
from ruptfx.interfaces.faults.point_code import LANES
from ruptfx.interfaces.sliding import Sliding
from ruptfx.interfaces.sliding.coupling import COLUMNS, Coupling
from ruptfx.interfaces.sliding.mortar import Mortar
from ruptfx.interfaces.sliding.surface import Floats, Integers, Surface, lattice_numbers, surface_of_facets
from ruptfx.platform import fem, parallel
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

JUMP = files("ruptfx.interfaces.sliding").joinpath("jump.c")
TOUCHING = 1e-6  # largest initial opening of touching surfaces over the length of a facet
STRIDE = 4  # of vectors in space, as in jump.c
BACKWARDS = 0.1  # one plus the cosine of normals that are nearly opposite to the mean normal
OVERLAP = 0.01  # largest initial overlap of the surfaces over the distance of nodes


class Table(ctypes.Structure):
    """`struct pairing` of jump.c."""

    _fields_ = [(name, ctypes.c_long) for name in ("n", "m", "columns", "width")] + [
        (name, ctypes.c_void_p) for name in (
            "dofs", "first", "coupling", "paired", "transposed", "frame", "weight", "across", "back", "forces", "nodes",
            "points",
        )
    ]  # fmt: skip


@cache
def _library(dim: int) -> ctypes.CDLL:
    library = native.load("jump", JUMP.read_text(), {"COMPONENTS": dim})
    library.largest_difference.restype = ctypes.c_double
    return library


class Geometry:
    """Variable quantities of a sliding interface: B, frames and weights, overwritten in place.

    Parameters
    ----------
    plus, minus : Surface
    reference : ndarray, shape (dim,), optional
        Vector across a surface whose tangents are the fixed directions [-]; default: the mean normal.

    Attributes
    ----------
    dim : int
        Components of a jump: the normal one and those along the tangents.
    reference : ndarray, shape (dim,), or None
        That of a surface, as above.
    coupling : Coupling
        B of the movable nodes, of which a rigid surface has none.
    opposite : Coupling
        B of all nodes of the opposite surface; the same unless that is rigid.
    offset : ndarray, shape (n, dim)
        [m]
    covered : ndarray of bool, shape (n,)
        Whether a point has a partner on the opposite surface.
    all_covered : bool
    revision : int
        Number of updates.
    slides : float
        Upper bound of the slip of all points in the next step, infinite if unknown [m].
    table : Table
        The same data for the C code.
    shape_across : tuple of int
        Shape of an array of vectors at the nodes of the other side in the C code.
    """

    coupling: Coupling
    opposite: Coupling
    covered: NDArray[np.bool_]

    def __init__(self, plus: Surface, minus: Surface, reference: Floats | None = None) -> None:
        self.plus, self.minus, self.reference = plus, minus, reference
        self._mortar = Mortar(plus, minus)
        n, self.dim = plus.points.shape
        self.frame, self.weight, self.offset = np.zeros((n, self.dim, self.dim)), np.zeros(n), np.zeros((n, self.dim))
        self.nearest = np.zeros(n, dtype=np.int64)
        self._acting = np.zeros_like(self.frame)  # frames, zero for points without a partner
        self._dofs = self.dim * np.concatenate([plus.nodes, minus.nodes])
        self.shape_across: tuple[int, ...] = (0,)
        self.coupling = self.opposite = Coupling(np.zeros(n, dtype=np.int64), np.zeros((n, 0)), len(minus.nodes))
        self.covered, self.all_covered = np.zeros(0, dtype=bool), True
        self.revision, self.table, self.slides = 0, Table(), np.inf
        self.follow(np.zeros((n + len(minus.nodes), self.dim)), np.zeros((n, self.dim - 1)))

    def follow(self, displacement: Floats, slip: Floats, before: Floats | None = None) -> None:
        """Update the pairing of all points.

        Parameters
        ----------
        displacement : ndarray, shape (nodes of both surfaces, dim)
            Displacement of the plus, then of the minus side [m].
        slip : ndarray, shape (n, tangents)
            Tangential jump so far, which remains continuous [m].
        before : ndarray, shape (nodes of both surfaces, dim), optional
            Displacement with that jump [m]; default: `displacement`.

        Raises
        ------
        RuptfxError
            A surface that folds back.
        """
        self.revision += 1
        n, rigid = len(self.plus.nodes), not len(self.minus.nodes)
        if not n:
            return
        there = self.minus.points if rigid else self.minus.points + displacement[n:]
        result = self._mortar.find(self.plus.points + displacement[:n], there)
        if self.dim == 3 and self.reference is None:  # of the first pairing, which all ranks with the interface compute
            self.reference = result.weight @ result.normal
            self.reference /= np.linalg.norm(self.reference)
        self.frame[:] = turned_frame(result.normal, self.reference)
        self._acting[:] = self.frame * result.covered[:, None, None]
        self.opposite, self.weight[:], self.covered = result.coupling, result.weight, result.covered
        self.all_covered = bool(self.covered.all())
        none = Coupling(np.zeros(n, dtype=np.int64), np.zeros((n, COLUMNS)), 0)
        self.coupling = none if rigid else result.coupling
        self._tabulate()
        apart = self.plus.points - self.opposite @ self.minus.points
        before = displacement if before is None else before
        moved = before[:n] - self.coupling @ before[n:]
        self.offset[:, 0] = np.where(self.covered, np.sum(self.frame[:, 0] * apart, axis=1), self._far)
        self.offset[:, 1:] = slip - np.sum(self._acting[:, 1:] * moved[:, None], axis=2)
        self.nearest[:] = self.plus.nodes if rigid else self.minus.nodes[self.coupling.nearest()]

    def _tabulate(self) -> None:
        coupling, back = self.coupling, self.coupling.transposed()
        n, m, columns, width = (
            len(self.plus.nodes),
            len(self.minus.nodes),
            coupling.values.shape[1],
            back.values.shape[1],
        )
        arrays: tuple[NDArray[Any], ...]
        if self.dim == 2:
            rows = coupling.first, coupling.values, back.first, back.values
            arrays = *np.zeros((2, 2, m + columns)), np.zeros((2, n + width))
        else:
            (begin, values, nodes), (paired, transposed, points) = _entries(coupling), _entries(back)
            rows = begin, values, paired, transposed
            arrays = *np.zeros((2, m, STRIDE)), np.zeros((n + LANES, STRIDE)), nodes, points
        self.shape_across = arrays[0].shape
        self._arrays = (self._dofs, *rows, self._acting, self.weight, *arrays)
        self.table = Table(n, m, columns, width, *(array.ctypes.data for array in self._arrays))

    def rate(self, field: Floats) -> Floats:
        """Return J field for all degrees of freedom of this rank, shape (n, dim)."""
        local = np.zeros((len(self.plus.nodes), self.dim))
        _library(self.dim).jump(ctypes.byref(self.table), _pointer(field), _pointer(local))
        return local

    def assemble(self, traction: Floats, out: Floats) -> None:
        """Add J' W traction to `out`."""
        _library(self.dim).assemble(ctypes.byref(self.table), _pointer(traction), _pointer(out))

    def largest_difference(self, field: Floats, values: Floats) -> float:
        """Return the largest difference of a field from values at all `dofs` of both sides."""
        size: float = _library(self.dim).largest_difference(ctypes.byref(self.table), _pointer(field), _pointer(values))
        return size

    def opposite_values(self, values: Floats) -> Floats:
        """Return values of the minus side interpolated to the points; NaN for points without a partner."""
        result = self.opposite @ values
        result[~self.covered] = np.nan
        return result

    @property
    def tangents(self) -> Floats:
        """Tangents of the mean normal of a surface, shape (2, 3)."""
        assert self.reference is not None
        frame: Floats = local_frame(self.reference[None])[0, 1:]
        return frame

    @property
    def _far(self) -> float:
        """Gap assigned to points without a partner [m]."""
        return 10 * self.plus.spacing


def turned_frame(normal: Floats, reference: Floats | None) -> Floats:
    """Return rows normal and tangents of every point, shape (n, dim, dim).

    In space they are the frame of the reference in the smallest rotation that takes it to the normal. Unlike those of
    projections, slip along them does not depend on which two directions are the tangents of the reference.
    """
    if reference is None:
        return np.asarray(local_frame(normal))
    start = local_frame(reference[None])[0]
    cosine = 1 + normal @ reference
    part = normal @ start[1:].T / np.maximum(cosine, BACKWARDS)[:, None]
    frame = np.concatenate([normal[:, None], start[1:] - part[..., None] * (normal + reference)[:, None]], axis=1)
    averted = cosine < BACKWARDS
    frame[averted] = local_frame(normal[averted], reference)
    return np.asarray(frame)


def _entries(coupling: Coupling) -> tuple[Integers, Floats, NDArray[np.int32]]:
    """Return the first entry of every row, and value and node of all entries that are not zero."""
    chosen = coupling.values != 0
    begin = np.concatenate([[0], np.cumsum(chosen.sum(axis=1))])
    return begin, coupling.values[chosen], np.ascontiguousarray(coupling.columns[chosen], dtype=np.int32)


def _pointer(array: Floats) -> ctypes.c_void_p:
    assert array.flags.c_contiguous and array.dtype == np.float64
    return address(array)


@dataclass(frozen=True, kw_only=True)
class SlidingInterface(Interface):
    """An interface with finite sliding; `minus` is the nearest node of the opposite side, for data of its body.

    For a rigid base, whose surface does not move, it is `plus`.

    Attributes
    ----------
    geometry : Geometry
    limit : float
        Slip after which explicit steps update the pairing [m].
    step_limit : float
        Largest slip of an implicit step [m].
    near : float
        Motion after which they update it if points have no partner: the length of a facet [m].
    """

    geometry: Geometry
    limit: float
    step_limit: float
    near: float

    @property
    def nodes(self) -> Integers:
        """Local nodes of both surfaces."""
        return np.concatenate([self.geometry.plus.nodes, self.geometry.minus.nodes])

    def touches(self, opening: Floats) -> NDArray[np.bool_]:
        return self.covered & (opening <= TOUCHING * self.near)

    @property
    def surface_points(self) -> Floats:
        plus, minus = self.geometry.plus, self.geometry.minus
        return np.concatenate([plus.points, minus.points[: len(minus.nodes)]])

    @cached_property
    def dofs(self) -> Integers:
        """Local degrees of freedom of both surfaces."""
        dim = self.geometry.dim
        result: Integers = (dim * self.nodes[:, None] + np.arange(dim)).ravel()
        return result

    @property
    def resting_jump(self) -> Floats:
        return np.maximum(self.initial.geometry.offset[:, 0], 0.0)

    @property
    def covered(self) -> NDArray[np.bool_]:
        return self.geometry.covered

    def without_partner(self) -> tuple[Integers, Floats]:
        """Return nodes without a partner on the opposite side, and the length or area of each [m or m^2]."""
        plus, minus, coupling = self.geometry.plus, self.geometry.minus, self.geometry.coupling
        if self.covered.all():
            return super().without_partner()
        met = np.zeros(coupling.nodes)
        if coupling.nodes:
            np.add.at(met, coupling.columns, coupling.values)
        alone = np.concatenate([~self.covered, met == 0])
        return self.nodes[alone], np.concatenate([plus.measures, minus.measures[: coupling.nodes]])[alone]

    def jump(self, field: Floats) -> Floats:
        return self.geometry.offset + self.rate(field)

    def places(self, displacement: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the positions of the points and of their partners [m].

        Returns
        -------
        tuple of ndarray, shapes (n,), (n, dim) and (n, dim)
            Undeformed position of the partners along their surface; present coordinates of the points and of the
            partners.
        """
        n, minus = len(self.plus), self.geometry.minus.points
        now = self.surface_points + displacement[self.dofs].reshape(-1, self.geometry.dim)
        along = minus[:, 0]
        if self.line.measure == "arc length":
            along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(minus, axis=0), axis=1))])[: len(minus)]
        elif self.line.measure == "first tangent":
            along = (minus - self.line.origin) @ self.geometry.tangents[0]
        there = now[n:] if len(self.geometry.minus.nodes) else minus
        return self.geometry.opposite_values(along), now[:n], self.geometry.opposite_values(there)

    def rate(self, field: Floats) -> Floats:
        return self.geometry.rate(np.ascontiguousarray(field, dtype=float))

    def assemble(self, traction: Floats, out: Floats) -> None:
        self.geometry.assemble(np.ascontiguousarray(traction, dtype=float), out)

    def stencil(self) -> tuple[Integers, Floats]:
        coupling = self.geometry.coupling
        if self.one_sided:
            return self.plus[:, None], (self.frame * self.covered[:, None, None])[:, None]
        nodes = np.column_stack([self.plus, self.geometry.minus.nodes[coupling.columns]])
        shares = np.column_stack([np.ones(len(self.plus)), -coupling.values]) * self.covered[:, None]
        return nodes, np.einsum("ij,ikc->ijkc", shares, self.frame)

    @cached_property
    def initial(self) -> SlidingInterface:
        geometry = Geometry(self.geometry.plus, self.geometry.minus, self.geometry.reference)
        return replace(self, geometry=geometry, frame=geometry.frame, weight=geometry.weight, minus=geometry.nearest)


def build_sliding(nodes: Nodes, name: str, table: Sliding) -> SlidingInterface:
    """Return the interface between two surfaces with meshes of their own.

    Parameters
    ----------
    nodes : Nodes
        Nodes of the displacement.
    table : Sliding
        Options of finite sliding in the case.

    Raises
    ------
    RuptfxError
        On all ranks: one body or none on the other side, surfaces that are no open chains or overlap, antiplane,
        solids of tetrahedra.
    """
    comm = nodes.comm
    error: Exception | None = None
    face = None
    try:
        face = _local(nodes, name, table)
    except RuptfxError as caught:
        error = caught
    parallel.raise_on_all(comm, error)
    assert face is not None
    return _in_order(comm, face) if face.geometry.dim == 2 else _on_surface(comm, face)


def _local(nodes: Nodes, name: str, table: Sliding) -> SlidingInterface:
    """Return the interface on this rank, without the line and the number of points, which need all ranks."""
    space, bodies = nodes.space, nodes.bodies
    dim = space.mesh.geometry.dim
    if space.dofmap.index_map_bs != dim:
        raise RuptfxError(
            f"faults.{name}.sliding: only motion in a plane (plane = 'stress' or 'strain') and of solids slides far; "
            "remove this table"
        )
    if dim == 3 and space.mesh.basix_cell().name != "hexahedron":
        raise RuptfxError(
            f"faults.{name}.sliding: the bodies are of {space.mesh.basix_cell().name} elements, and solids slide on "
            "sides of hexahedra only; mesh them with hexahedra (in Gmsh transfinite volumes with 'Recombine'), or "
            "remove this table"
        )
    base = bodies.bases.get(name)
    if name in bodies.one_sided and base is None:
        rough = ", or give mesh.base, a surface to slide on" * (bodies.one_sided[name] == "rigid")
        raise RuptfxError(
            f"faults.{name}.sliding: the minus side is not meshed ({bodies.one_sided[name]}), nothing there can slide "
            f"away; remove this table, or mesh both bodies{rough}"
        )
    coordinates = fem.from_owners(space, nodes.coordinates)

    def surface(side: str, facets: Integers) -> Surface:
        cells = _cells_of(space, facets)
        if dim == 3:
            return _patch(space, coordinates, cells, inward=side == "plus", name=f"{name}.{side}")
        return _chain(space, coordinates, cells, left=side == "plus", name=f"{name}.{side}")

    plus = surface("plus", bodies.surfaces[name][0])
    minus = surface("minus", bodies.surfaces[name][1]) if base is None else _rigid(base, plus)
    if np.isin(np.concatenate([nodes.kept, nodes.copies]), np.concatenate([plus.nodes, minus.nodes])).any():
        raise RuptfxError(
            f"faults.{name}.sliding: the interface ends at periodic edges, and what slides has two ends; remove this "
            "table or that boundary"
        )
    try:
        geometry = Geometry(plus, minus, bodies.reference_normals.get(name))
    except RuptfxError as error:
        raise RuptfxError(f"faults.{name}: {error}") from None
    spacing = plus.spacing if len(plus.nodes) else 0.0
    gap = geometry.offset[:, 0]
    if len(gap) and gap.min() < -OVERLAP * spacing:
        worst = int(np.argmin(gap))
        place = ", ".join(f"{value:.6g}" for value in plus.points[worst])
        raise RuptfxError(
            f"interface '{name}': the bodies overlap by {-gap[worst]:.4g} m at ({place}) m before anything "
            f"moves, at most {OVERLAP * spacing:.2g} m (a hundredth of the distance of nodes) are taken; move one of "
            "them away"
        )
    n = len(plus.nodes)
    return SlidingInterface(
        points=plus.points, position=np.zeros(n), number=np.arange(n), plus=plus.nodes, minus=geometry.nearest,
        frame=geometry.frame, weight=geometry.weight, owned=plus.nodes < nodes.owned, total=n,
        line=Line("x", np.zeros(dim), 0.0, 0.0), geometry=geometry,
        other_side=bodies.one_sided.get(name, "meshed"), limit=table.update_slip * spacing,
        step_limit=table.limit * spacing, near=plus.order * spacing,
    )  # fmt: skip


def _rigid(base: Base, plus: Surface) -> Surface:
    """Return the surface of a rigid base in facets about as long as those of the other side."""
    nodes, dim = np.zeros(0, dtype=np.int64), plus.points.shape[1]
    if not plus.facets:
        return Surface(nodes, np.zeros((0, dim)), plus.order, None if dim == 2 else plus.numbers)
    corners = plus.points[plus.numbers[:, [0, -1]]]
    facet = np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)) / np.sqrt(dim - 1)  # diagonal of a square

    def along(ends: tuple[float, float]) -> Floats:
        first, last = ends
        return nodes_between(np.linspace(first, last, max(1, round((last - first) / facet)) + 1), plus.order)

    if base.sides is None:
        return Surface(nodes, base.points(along(base.ends)), plus.order)
    x, y = along(base.ends), along(base.sides)
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    numbers = lattice_numbers(((len(x) - 1) // plus.order, (len(y) - 1) // plus.order), plus.order)
    return Surface(nodes, base.points(places), plus.order, numbers)


def _cells_of(space: fem.dolfinx.fem.FunctionSpace, facets: Integers) -> Integers:
    """Return local cell, ghosts included, and number in the cell of the facets this rank knows, shape (facets, 2)."""
    mesh = space.mesh
    local = FACETS[mesh.basix_cell().name]
    corners = fem.geometry_dofmap(mesh)[:, : 1 + max(map(max, local))]
    inputs = mesh.geometry.input_global_indices[corners]
    wanted = {frozenset(facet) for facet in facets.tolist()}
    near = np.flatnonzero(np.isin(inputs, facets).sum(axis=1) >= facets.shape[1])
    items = [
        (cell, number)
        for cell, vertices in zip(near.tolist(), inputs[near].tolist(), strict=True)
        for number, facet in enumerate(local)
        if frozenset(vertices[i] for i in facet) in wanted
    ]
    return np.array(items, dtype=np.int64).reshape(-1, 2)


def _chain(
    space: fem.dolfinx.fem.FunctionSpace, coordinates: Floats, facets: Integers, left: bool, name: str
) -> Surface:
    """Return facets as one chain, with the body on the left for the plus side and on the right for the minus side.

    Raises
    ------
    RuptfxError
        Facets that are not one open chain.
    """
    order = space.element.basix_element.degree
    if not len(facets):
        return Surface(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), order)
    dofs = space.dofmap.list
    closure = [space.dofmap.dof_layout.entity_closure_dofs(1, number) for number in range(facets[:, 1].max() + 1)]
    rows = []
    for cell, number in facets.tolist():
        nodes = dofs[cell][closure[number]]
        x = coordinates[nodes]
        chord = x[1] - x[0]  # closures begin with the vertices
        inward = coordinates[dofs[cell]].mean(axis=0) - x[:2].mean(axis=0)
        turn = chord[0] * inward[1] - chord[1] * inward[0]
        chord = chord if (turn > 0) == left else -chord
        rows.append(nodes[np.argsort(x @ chord)])
    follows = {int(row[0]): row for row in rows}
    begins = set(follows) - {int(row[-1]) for row in rows}
    chain: list[Integers] = []
    node = min(begins, default=-1)
    while node in follows and len(chain) < len(rows):
        chain.append(follows[node])
        node = int(chain[-1][-1])
    if len(begins) != 1 or len(chain) != len(rows):
        raise RuptfxError(
            f"{name}: {len(rows)} facets that are not one line with two ends; an interface that slides has one piece, "
            "is not closed and does not branch"
        )
    nodes = np.concatenate([row[:-1] for row in chain] + [chain[-1][-1:]]).astype(np.int64)
    return Surface(nodes, coordinates[nodes], order)


def _patch(
    space: fem.dolfinx.fem.FunctionSpace, coordinates: Floats, facets: Integers, inward: bool, name: str
) -> Surface:
    """Return sides of hexahedra as a surface, with normals into the body if `inward`, else out of it.

    Raises
    ------
    RuptfxError
        Facets that are no surface with a rim.
    """
    element, dofs = space.element.basix_element, space.dofmap.list
    order, places = element.degree, np.asarray(element.points, dtype=float)
    tensor = {}
    for number in np.unique(facets[:, 1]).tolist():
        closure = np.asarray(space.dofmap.dof_layout.entity_closure_dofs(2, number))
        across, along = np.flatnonzero(np.ptp(places[closure], axis=0) > 0.5)
        tensor[number] = closure[np.lexsort((places[closure, along], places[closure, across]))]
    nodes = [dofs[cell][tensor[number]] for cell, number in facets.tolist()]
    inside = coordinates[dofs[facets[:, 0]]].mean(axis=1)
    return surface_of_facets(
        np.array(nodes, dtype=np.int64).reshape(-1, (order + 1) ** 2), coordinates, inside, order=order, inward=inward,
        name=name,
    )  # fmt: skip


def _on_surface(comm: fem.MPI.Comm, face: SlidingInterface) -> SlidingInterface:
    """Return the interface of solids with positions along the first tangent of the mean normal and across it."""
    references = [each for each in comm.allgather(face.geometry.reference) if each is not None]
    position, across, number, total, line, _ = order_points(
        comm, face.points, face.owned, face.frame[:, 0], references[0]
    )
    face.geometry.reference = references[0]
    return replace(face, position=position, across=across, number=number, total=total, line=line)


def _in_order(comm: fem.MPI.Comm, face: SlidingInterface) -> SlidingInterface:
    """Return the interface with positions: x if the plus side runs along it, else the length along the surface."""
    share = parallel.share_rows(comm, np.column_stack([face.number, face.points])[face.owned])
    points = share[np.argsort(share[:, 0]), 1:]
    steps = np.diff(points, axis=0)
    if np.all(steps[:, 0] > 0):
        extent = np.abs(points[:, 0]).max()  # scale for rounding
        x = np.round(points[:, 0] / extent, 13) * extent + 0.0
        line = Line("x", np.array([0.0, points[0, 1]]), float(x[0]), float(x[-1]))
        position = x[face.number]
    else:
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
        line = Line("arc length", points[0], 0.0, float(along[-1]))
        position = along[face.number]
    return replace(face, position=position, total=len(points), line=line)
