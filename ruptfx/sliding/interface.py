"""The jump of an interface that slides, and its exact transpose.

Points are the nodes of the plus side; each faces a mean of nodes of the minus side (`ruptfx.sliding.facing`). The jump
is affine in the displacement,

    [u] = offset + frame (u+ - B u-),

with an offset that makes the normal part the gap, now that the surfaces are where they are, and that keeps the
tangential part what it was when B and the frames change: what sticks stays stuck, and the sum of all slip goes on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ruptfx import RuptfxError, fem, parallel
from ruptfx.interface import Interface, Line, local_frame
from ruptfx.meshes import FACETS
from ruptfx.nodes import Nodes
from ruptfx.sliding.facing import Facing, Mortar
from ruptfx.sliding.surface import Floats, Integers, Surface

OVERLAP = 0.01  # of the distance of nodes: what surfaces may overlap before anything moves


class Geometry:
    """What changes in an interface that slides: B, frames and weights, overwritten in place.

    Parameters
    ----------
    plus, minus : Surface

    Attributes
    ----------
    jump : csr_matrix, shape (2 n, degrees of freedom of both surfaces)
        Rows: normal and tangential jump of every point.
    offset : ndarray, shape (n, 2)
        [m]
    covered : ndarray of bool, shape (n,)
        Whether a point faces anything.
    revision : int
        Grows with every update.
    """

    def __init__(self, plus: Surface, minus: Surface) -> None:
        self.plus, self.minus = plus, minus
        self._mortar = Mortar(plus, minus)
        n = len(plus.nodes)
        self.frame, self.weight, self.offset = np.zeros((n, 2, 2)), np.zeros(n), np.zeros((n, 2))
        self.nearest = np.zeros(n, dtype=np.int64)
        self._coupling = sparse.csr_matrix((n, len(minus.nodes)))
        self.jump, self.covered = sparse.csr_matrix((0, 0)), np.zeros(0, dtype=bool)
        self.revision = 0
        self.follow(np.zeros((n + len(minus.nodes), 2)), np.zeros(n))

    def follow(self, displacement: Floats, slip: Floats) -> None:
        """Find what every point faces.

        Parameters
        ----------
        displacement : ndarray, shape (nodes of both surfaces, 2)
            Of the plus, then of the minus side [m].
        slip : ndarray, shape (n,)
            The tangential jump so far, which goes on [m].

        Raises
        ------
        RuptfxError
            A surface that folds back.
        """
        self.revision += 1
        n = len(self.plus.nodes)
        if not n:
            return
        found = self._mortar.find(self.plus.points + displacement[:n], self.minus.points + displacement[n:])
        self.frame[:] = local_frame(np.stack([-found.tangent[:, 1], found.tangent[:, 0]], axis=1))
        self.weight[:], self.covered, self._coupling = found.weight, found.covered, found.coupling
        self.jump = self._rows(found)
        apart = np.einsum("ikc,ic->ik", self.frame, self.plus.points - found.coupling @ self.minus.points)
        linear = (self.jump @ displacement.ravel()).reshape(n, 2)
        self.offset[:, 0] = np.where(self.covered, apart[:, 0], self._far)
        self.offset[:, 1] = np.where(self.covered, slip - linear[:, 1], slip)
        self.nearest[:] = self.minus.nodes[np.asarray(found.coupling.argmax(axis=1)).ravel()]

    def faced(self, values: Floats) -> Floats:
        """What is given at the nodes of the minus side, as the points face it; NaN where they face nothing."""
        found: Floats = self._coupling @ values
        found[~self.covered] = np.nan
        return found

    @property
    def _far(self) -> float:
        """How far apart points are that face nothing [m]."""
        return 10 * self.plus.spacing

    def _rows(self, found: Facing) -> sparse.csr_matrix:
        """Rows of J; none where nothing is faced."""
        n, m = found.coupling.shape
        frame = self.frame * found.covered[:, None, None]
        points, local, component = np.meshgrid(np.arange(n), [0, 1], [0, 1], indexing="ij")
        coupling = found.coupling.tocoo()
        i, j = (index[:, None, None] for index in (coupling.row, coupling.col))
        shape = (len(i), 2, 2)
        faced = np.broadcast_to(2 * i + [[0], [1]], shape), np.broadcast_to(2 * (n + j) + [0, 1], shape)
        rows = np.concatenate([(2 * points + local).ravel(), faced[0].ravel()])
        columns = np.concatenate([(2 * points + component).ravel(), faced[1].ravel()])
        values = np.concatenate([frame.ravel(), (-coupling.data[:, None, None] * self.frame[coupling.row]).ravel()])
        return sparse.csr_matrix((values, (rows, columns)), shape=(2 * n, 2 * (n + m)))


@dataclass(frozen=True, kw_only=True)
class SlidingInterface(Interface):
    """An interface that slides; `minus` is the node that a point faces most, for what depends on the body there.

    Attributes
    ----------
    geometry : Geometry
    limit : float
        Slip after which it is found again what points face [m].
    near : float
        Motion after which that is done where points face nothing: the length of a facet [m].
    """

    geometry: Geometry
    limit: float
    near: float

    @property
    def nodes(self) -> Integers:
        """Local nodes of both surfaces."""
        return np.concatenate([self.geometry.plus.nodes, self.geometry.minus.nodes])

    @property
    def surface_points(self) -> Floats:
        return np.concatenate([self.geometry.plus.points, self.geometry.minus.points])

    @cached_property
    def dofs(self) -> Integers:
        """Local degrees of freedom of both surfaces."""
        return (2 * self.nodes[:, None] + np.arange(2)).ravel()

    @property
    def resting_jump(self) -> Floats:
        return np.maximum(self.initial.geometry.offset[:, 0], 0.0)

    @property
    def covered(self) -> NDArray[np.bool_]:
        return self.geometry.covered

    def jump(self, field: Floats) -> Floats:
        return self.geometry.offset + self.rate(field)

    def places(self, displacement: Floats) -> tuple[Floats, Floats, Floats]:
        """Where the points and what they face are [m].

        Returns
        -------
        tuple of ndarray, shapes (n,), (n, 2) and (n, 2)
            Position of what they face along its surface where nothing has moved; places of the points and of what they
            face, displaced.
        """
        n, minus = len(self.plus), self.geometry.minus.points
        now = self.surface_points + displacement[self.dofs].reshape(-1, 2)
        along = minus[:, 0]
        if self.line.measure != "x":
            along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(minus, axis=0), axis=1))])[: len(minus)]
        return self.geometry.faced(along), now[:n], self.geometry.faced(now[n:])

    def rate(self, field: Floats) -> Floats:
        found: Floats = self.geometry.jump @ field[self.dofs]
        return found.reshape(-1, 2)

    def assemble(self, traction: Floats, out: Floats) -> None:
        out[self.dofs] += self.geometry.jump.T @ (self.weight[:, None] * traction).ravel()

    @cached_property
    def initial(self) -> SlidingInterface:
        geometry = Geometry(self.geometry.plus, self.geometry.minus)
        return replace(self, geometry=geometry, frame=geometry.frame, weight=geometry.weight, minus=geometry.nearest)


def build_sliding(nodes: Nodes, name: str, follow: float) -> SlidingInterface:
    """The interface between two surfaces with meshes of their own.

    Parameters
    ----------
    nodes : Nodes
        Of the displacement.
    name : str
    follow : float
        Slip over the distance of nodes after which facing is found again.

    Raises
    ------
    RuptfxError
        On all ranks: one body or none on the other side, surfaces that are no open chains or overlap, antiplane, 3D.
    """
    comm = nodes.comm
    error: Exception | None = None
    face = None
    try:
        face = _local(nodes, name, follow)
    except RuptfxError as caught:
        error = caught
    parallel.raise_on_all(comm, error)
    assert face is not None
    return _in_order(comm, face)


def _local(nodes: Nodes, name: str, follow: float) -> SlidingInterface:
    """As this rank knows it; the line and the number of points are found later, by all together."""
    space, bodies = nodes.space, nodes.bodies
    if space.mesh.geometry.dim != 2 or space.dofmap.index_map_bs != 2:
        raise RuptfxError(
            f"faults.{name}.sliding: only motion in a plane slides far (plane = 'stress' or 'strain'); remove "
            "this table"
        )
    if name in bodies.one_sided:
        raise RuptfxError(
            f"faults.{name}.sliding: the minus side is not meshed ({bodies.one_sided[name]}), nothing there can slide "
            "away; remove this table, or mesh both bodies"
        )
    coordinates = fem.from_owners(space, nodes.coordinates)
    plus, minus = (
        _chain(space, coordinates, _cells_of(space, facets), left=side == "plus", name=f"{name}.{side}")
        for side, facets in zip(("plus", "minus"), bodies.surfaces[name], strict=True)
    )
    if np.isin(np.concatenate([nodes.kept, nodes.copies]), np.concatenate([plus.nodes, minus.nodes])).any():
        raise RuptfxError(
            f"faults.{name}.sliding: the interface ends at periodic edges, and what slides has two ends; remove this "
            "table or that boundary"
        )
    geometry = Geometry(plus, minus)
    spacing = plus.spacing if len(plus.nodes) else 0.0
    gap = geometry.offset[:, 0]
    if len(gap) and gap.min() < -OVERLAP * spacing:
        worst = int(np.argmin(gap))
        x, y = plus.points[worst]
        raise RuptfxError(
            f"interface '{name}': the bodies overlap by {-gap[worst]:.4g} m at ({x:.6g}, {y:.6g}) m before anything "
            f"moves, at most {OVERLAP * spacing:.2g} m (a hundredth of the distance of nodes) are taken; move one of "
            "them away"
        )
    n = len(plus.nodes)
    return SlidingInterface(
        points=plus.points, position=np.zeros(n), number=np.arange(n), plus=plus.nodes, minus=geometry.nearest,
        frame=geometry.frame, weight=geometry.weight, owned=plus.nodes < nodes.owned, total=n,
        line=Line("x", np.zeros(2), 0.0, 0.0), geometry=geometry, limit=follow * spacing,
        near=plus.order * spacing,
    )  # fmt: skip


def _cells_of(space: fem.dolfinx.fem.FunctionSpace, facets: Integers) -> Integers:
    """Local cell, ghosts included, and number in it of the facets this rank knows, shape (facets, 2)."""
    mesh = space.mesh
    local = FACETS[mesh.basix_cell().name]
    corners = fem.geometry_dofmap(mesh)[:, : 1 + max(map(max, local))]
    inputs = mesh.geometry.input_global_indices[corners]
    wanted = {frozenset(facet) for facet in facets.tolist()}
    near = np.flatnonzero(np.isin(inputs, facets).sum(axis=1) > 1)
    found = [
        (cell, number)
        for cell, vertices in zip(near.tolist(), inputs[near].tolist(), strict=True)
        for number, facet in enumerate(local)
        if frozenset(vertices[i] for i in facet) in wanted
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _chain(
    space: fem.dolfinx.fem.FunctionSpace, coordinates: Floats, facets: Integers, left: bool, name: str
) -> Surface:
    """Facets one after the other; the body is on the left of the chain of the plus side, on the right of the other's.

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


def _in_order(comm: fem.MPI.Comm, face: SlidingInterface) -> SlidingInterface:
    """With positions: x where the plus side runs along it, else the length along the surface."""
    share = parallel.share_rows(comm, np.column_stack([face.number, face.points])[face.owned])
    points = share[np.argsort(share[:, 0]), 1:]
    steps = np.diff(points, axis=0)
    if np.all(steps[:, 0] > 0):
        line = Line("x", np.array([0.0, points[0, 1]]), float(points[0, 0]), float(points[-1, 0]))
        position = face.points[:, 0]
    else:
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
        line = Line("arc length", points[0], 0.0, float(along[-1]))
        position = along[face.number]
    return replace(face, position=position, total=len(points), line=line)
