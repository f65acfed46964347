"""An interface between two bodies: paired nodes, local frame, weights, the jump and its exact transpose.

SIGN CONVENTION (converted here and nowhere else)

* The normal n points from the minus to the plus body; in 2D the tangent is t = (n_y, -n_x), so that t = +x for n = +y.
* Jump = u(plus) - u(minus). Local components are (normal, tangents...), in antiplane the single out-of-plane one.
  Slip is the tangential jump, opening the normal jump.
* Traction T acts from the plus body on the minus body, T = stress . n: positive shear traction resists positive
  slip. The normal component of T is tension; `normal_stress` = -T_n is compression.
* The force on the bodies is -J' W T: on the plus side -w T, on the minus side +w T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.space.closest import closest
from ruptfx.bodies.space.nodes import Nodes, largest_extent
from ruptfx.platform import fem, parallel

Measure = Literal["x", "arc length", "first tangent"]
FLAT = 1e-6  # largest deviation from a plane, and of a direction from x, for positions to be x: an error of 1e-12
HORIZONTAL = 0.05  # largest horizontal part of the unit normal of a surface without dip: 3 degrees
CLOSED = 1e-9  # length of the mean of unit normals below which a surface is closed and has no mean direction
ALIGNED = 0.99  # cosine between a normal and the tangent of the mean normal above which the other tangent replaces it


@dataclass(frozen=True)
class Line:
    """Definition of positions along an interface, the same on every rank.

    Where an interface is flat and its (first) tangent is +x, they are x. Elsewhere, from the end at which the mean
    tangent begins: in 2D the arc length; in 3D the distance along the first tangent of the mean normal.

    Attributes
    ----------
    measure : str
        ``x``, ``arc length`` or ``first tangent``.
    origin : ndarray, shape (dim,)
        Point of position zero [m]; for ``x`` on the line or plane of the interface, possibly beyond its ends.
    first, last : float
        Positions of the two ends [m].
    """

    measure: Measure
    origin: np.ndarray
    first: float
    last: float

    @property
    def length(self) -> float:
        """Distance between the two ends [m]."""
        return self.last - self.first

    @property
    def meaning(self) -> str:
        """Definition of the position as text."""
        return self.meaning_in(1.0, "m")

    def meaning_in(self, size: float, unit: str) -> str:
        """Return the definition of the position as text, with its origin in a unit of this size [m]."""
        start = "(" + ", ".join(f"{value / size:.6g}" for value in self.origin) + f") {unit}"
        return {"x": "x", "arc length": f"arc length from {start}"}.get(
            self.measure, f"along the first tangent from {start}"
        )


@dataclass(frozen=True)
class Interface:
    """Jump operator J of the points of this rank; shared points exist on every rank that shares them.

    Attributes
    ----------
    points : ndarray, shape (n, dim)
        Coordinates [m].
    position : ndarray, shape (n,)
        Position along the interface, defined by `line` [m].
    number : ndarray of int, shape (n,)
        Global index in an order along the interface that does not depend on the partition.
    plus, minus : ndarray of int, shape (n,)
        Local nodes of both sides.
    frame : ndarray, shape (n, local, components)
        Rows are the local directions: normal and tangents.
    weight : ndarray, shape (n,)
        Tributary length of the point [m], area [m2] in 3D.
    owned : ndarray of bool, shape (n,)
        True on exactly one rank for every point; sums over points count these.
    total : int
        Number of points of the whole interface.
    line : Line
        Definition of the positions.
    other_side : str
        `meshed`, or without a minus side (`minus` is then `plus`): `rigid`, `antisymmetric`, `symmetric`.
    across : ndarray, shape (n,), or None
        Of a surface: second position, along the second tangent of the mean normal, zero at its first edge [m]. Unless
        the surface is horizontal this is the distance down dip.
    """

    points: np.ndarray
    position: np.ndarray
    number: np.ndarray
    plus: np.ndarray
    minus: np.ndarray
    frame: np.ndarray
    weight: np.ndarray
    owned: np.ndarray
    total: int
    line: Line
    other_side: str = "meshed"
    across: np.ndarray | None = None

    @property
    def locations(self) -> np.ndarray:
        """Positions at which profiles are evaluated [m]: shape (n,) along a line, (n, 2) on a surface."""
        return self.position if self.across is None else np.stack([self.position, self.across], axis=1)

    @property
    def area(self) -> np.ndarray:
        """Tributary length of the points [m], area in 3D [m2], shape (n,); also where the weight is half of it."""
        return self.weight * (2.0 if self.other_side in ("antisymmetric", "symmetric") else 1.0)

    @property
    def one_sided(self) -> bool:
        """True if the minus side is not meshed."""
        return self.other_side != "meshed"

    @property
    def elastic_sides(self) -> bool:
        """True if both sides deform: meshed ones, and the mirror image of a half model."""
        return self.other_side != "rigid"

    @property
    def jump_factor(self) -> np.ndarray:
        """Jump over displacement of the plus side where it has no meshed partner, shape (local,).

        A mirror image moves with the opposite tangential (antisymmetric) or normal (symmetric) displacement; the
        weights of such an interface are half its area, because half its traction's work is done on each body.
        """
        normal, tangential = {"antisymmetric": (0.0, 2.0), "symmetric": (2.0, 0.0)}.get(self.other_side, (1.0, 1.0))
        return np.array([normal] * self.has_normal + [tangential] * self.tangents)

    @property
    def rows(self) -> np.ndarray:
        """Local directions times `jump_factor`: the rows of J, shape (n, local, components)."""
        return self.frame * self.jump_factor[:, None]

    @property
    def nodes(self) -> np.ndarray:
        """Local nodes on which tractions act."""
        return np.concatenate([self.plus, self.minus])

    @property
    def surface_points(self) -> np.ndarray:
        """Coordinates of the nodes of both sides [m]; of one side if they coincide."""
        return self.points

    @property
    def initial(self) -> Interface:
        """The interface in the initial configuration."""
        return self

    @property
    def resting_jump(self) -> np.ndarray:
        """Initial normal jump, shape (n,) [m]."""
        return np.zeros(len(self.plus))

    def without_partner(self) -> tuple[np.ndarray, np.ndarray]:
        """Return unpaired nodes of both surfaces that may be paired later, and the tributary length of each [m]."""
        return np.zeros(0, dtype=np.int64), np.zeros(0)

    @property
    def has_normal(self) -> bool:
        """False in antiplane, which has no motion normal to the interface."""
        return self.frame.shape[2] > 1

    @property
    def tangents(self) -> int:
        """Number of tangents."""
        return self.frame.shape[1] - self.has_normal

    def jump(self, field: np.ndarray) -> np.ndarray:
        """Return the displacement jump in the local frame, J u.

        Parameters
        ----------
        field : ndarray, shape (nodes * components,)

        Returns
        -------
        ndarray, shape (n, local)
        """
        return self.rate(field)

    def rate(self, field: np.ndarray) -> np.ndarray:
        """Return J field, shape (n, local), for a velocity [m/s] or an increment of displacement [m].

        It equals `jump` except in finite sliding.
        """
        nodal = field.reshape(-1, self.frame.shape[2])
        difference = nodal[self.plus] if self.one_sided else nodal[self.plus] - nodal[self.minus]
        return np.einsum("ikc,ic->ik", self.rows, difference)

    def stencil(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the local nodes, shape (n, k), and blocks of every row of J, shape (n, k, local, components)."""
        if self.one_sided:
            return self.plus[:, None], self.rows[:, None]
        return np.stack([self.plus, self.minus], axis=1), np.stack([self.rows, -self.rows], axis=1)

    def assemble(self, traction: np.ndarray, out: np.ndarray) -> None:
        """Add J' W traction to `out`, with the traction in the local frame, shape (n, local)."""
        vector = self.weight[:, None] * np.einsum("ikc,ik->ic", self.rows, traction)
        nodal = out.reshape(-1, self.frame.shape[2])
        np.add.at(nodal, self.plus, vector)
        if not self.one_sided:
            np.subtract.at(nodal, self.minus, vector)

    def add_force(self, out: np.ndarray, traction: np.ndarray, scale: np.ndarray) -> None:
        """Subtract scale J' W traction from `out`: the force on the bodies, scaled for example by the inverse mass."""
        force = np.zeros_like(out)
        self.assemble(traction, force)
        out -= scale * force

    def touches(self, opening: np.ndarray) -> np.ndarray:
        """Return which points touch what they face where nothing has moved, shape (n,).

        Parameters
        ----------
        opening : ndarray, shape (n,)
            There [m].
        """
        return np.ones(len(opening), dtype=bool)

    def split(self, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return normal and tangential part of local components, shapes (n,) and (n, tangents)."""
        if not self.has_normal:
            return np.zeros(len(local)), local
        return local[:, 0], local[:, 1:]


def build_interface(nodes: Nodes, name: str) -> Interface:
    """Pair the nodes of the two sides of a named interface.

    The common point of adjacent interfaces belongs to the one that comes first in `bodies.interfaces`,
    with the area and the normal of both, as if they were one. An interface that ends inside welded bodies, or on
    another interface, has one node at its end, hence no jump and no point; there the other one has a point with its own
    area and normal. Its two ends at tied edges are one point, with the area and the
    normal of both. If every cell has its own nodes (`[fracture]`), the points are the ends of the facets, each at
    the middle of its half facet; a rank has the points that it owns.

    Parameters
    ----------
    nodes : Nodes
        Nodes of the displacement.
    name : str

    Raises
    ------
    RuptfxError
        On all ranks, if a node of one side has no partner on the other.
    """
    space, bodies, coordinates, components = nodes.space, nodes.bodies, nodes.coordinates, nodes.components
    comm, dim = nodes.comm, coordinates.shape[1]
    other_side = bodies.one_sided.get(name, "meshed")

    def of_side(side: str) -> np.ndarray:
        return fem.dolfinx.fem.locate_dofs_topological(space, dim - 1, bodies.facets.find(bodies.tags[side]))

    def welded(interface: str) -> np.ndarray:
        """Return the nodes that both sides share."""
        return np.intersect1d(of_side(f"{interface}.plus"), of_side(f"{interface}.minus"))

    ends = {side: _facet_ends(nodes, f"{name}.{side}") for side in ("plus", "minus")} if nodes.broken else {}
    if ends:
        places = {side: result.places for side, result in ends.items()}
        sides = {side: result.nodes for side, result in ends.items()}
    else:
        sides = {side: of_side(f"{name}.{side}") for side in ("plus", "minus")}
        places = {side: coordinates[result] for side, result in sides.items()}
    plus, minus, error = _pair(
        places["plus"], places["minus"], sides["plus"], sides["minus"], name, largest_extent(coordinates)
    )
    parallel.raise_on_all(comm, error)
    if ends:
        at = np.searchsorted(np.sort(ends["minus"].nodes), minus)
        chosen = np.argsort(ends["minus"].nodes)[at]
        normal, weight = ends["minus"].normal[chosen], ends["minus"].weight[chosen]
    else:
        alike = [other for other in bodies.interfaces if (other in bodies.one_sided) == (name in bodies.one_sided)]
        apart = {  # points at which one of both ends on the other: their areas are not added
            other: np.isin(minus, of_side(f"{other}.minus")) & ((plus == minus) | np.isin(minus, welded(other)))
            for other in alike if other != name and other_side == "meshed"
        }  # fmt: skip
        branches = [other for other, here in apart.items() if parallel.anywhere(comm, bool(np.any(here)))]
        tags = tuple(bodies.tags[f"{other}.minus"] for other in alike if other not in branches)
        area = _areas(nodes, tags, minus)
        for other in branches:
            area += np.where(apart[other][:, None], 0.0, _areas(nodes, (bodies.tags[f"{other}.minus"],), minus))
        size = np.linalg.norm(area[:, 1:], axis=1, keepdims=True)
        normal, weight = area[:, 1:] / np.maximum(size, 1e-300), area[:, 0]
    if other_side != "meshed":
        normal = -normal  # the outward normal of the plus body is opposite
    if other_side in ("antisymmetric", "symmetric"):
        weight = 0.5 * weight
    owned = plus < nodes.owned
    # The last digits depend on the cell a coordinate was computed from, hence on the partition.
    extent = parallel.largest(comm, np.abs(coordinates).max(initial=0))
    points = _rounded(places["plus"], extent)
    reference = bodies.reference_normals.get(name)
    position, across, number, total, line, mean = order_points(comm, points, owned, normal, reference, bodies.strike)
    if ends:  # the interface extends beyond its last points by half of their tributary length
        first, last = (
            parallel.largest(comm, np.where(number == place, 0.5 * ends["plus"].weight, 0.0).max(initial=0.0))
            for place in (0, total - 1)
        )
        line = replace(line, first=_rounded(line.first - first, extent), last=_rounded(line.last + last, extent))
    if other_side == "meshed":
        values = plus == minus
    else:  # the rim of a mirrored interface, which is welded in the whole
        values = np.isin(plus, of_side(bodies.mirror_planes[name]) if name in bodies.mirror_planes else [])
    for earlier in () if nodes.broken else bodies.interfaces[: bodies.interfaces.index(name)]:
        theirs = of_side(f"{earlier}.plus")
        values |= np.isin(plus, theirs if earlier in bodies.one_sided else np.setdiff1d(theirs, welded(earlier)))
    values |= np.isin(plus, nodes.copies)
    tied = np.concatenate([nodes.kept, nodes.copies])
    half = np.isin(plus, tied) != np.isin(minus, tied)
    if np.any(half):
        here = int(np.argmax(half))
        x = ", ".join(f"{value:.6g}" for value in points[here])
        keys = nodes.ties_of(int(plus[here] if np.isin(plus[here], tied) else minus[here]))
        error = RuptfxError(
            f"{keys}: the node at ({x}) m of one side of interface '{name}' is tied, that of the other side is not; "
            f"add kind = 'periodic' in [[boundaries]] for the edges of the other body, or remove {keys}"
        )
    parallel.raise_on_all(comm, error)
    gone = np.sort(parallel.share_rows(comm, number[owned & values]))
    number, total = number - np.searchsorted(gone, number), total - len(gone)
    frame = local_frame(normal, mean, bodies.strike) if components > 1 else np.ones((len(plus), 1, 1))
    # Points in order along the interface, for locality and readable files.
    order = np.flatnonzero(~values)[np.argsort(number[~values])]
    return Interface(
        points[order], position[order], number[order], plus[order].astype(np.int64), minus[order].astype(np.int64),
        frame[order], weight[order], owned[order], total, line, other_side,
        None if across is None else across[order],
    )  # fmt: skip


Lengths = TypeVar("Lengths", float, np.ndarray)


def _rounded(values: Lengths, extent: float) -> Lengths:
    """Return lengths without their last digits [m], which depend on the partition."""
    return np.round(values / extent, 13) * extent + 0.0  # no minus zero


@dataclass(frozen=True)
class _FacetEnds:
    """Ends of the facets of one side of an interface between cells with separate nodes.

    Attributes
    ----------
    nodes : ndarray of int, shape (n,)
        Local nodes owned by this rank.
    places : ndarray, shape (n, dim)
        Middle of the half facet of each end [m]: both ends at a vertex have different positions.
    normal : ndarray, shape (n, dim)
        Unit normal out of the body.
    weight : ndarray, shape (n,)
        Half the length of the facet [m].
    """

    nodes: np.ndarray
    places: np.ndarray
    normal: np.ndarray
    weight: np.ndarray


def _facet_ends(nodes: Nodes, side: str) -> _FacetEnds:
    """Find the ends of the facets of one side of an interface between bodies with nodes of their own in every cell.

    Raises
    ------
    RuptfxError
        On all ranks: a cell with two facets on the interface, whose common corner would have two partners.
    """
    mesh, bodies = nodes.space.mesh, nodes.bodies
    mesh.topology.create_connectivity(1, 2)
    facets = bodies.facets.find(bodies.tags[side])
    cells = np.array([mesh.topology.connectivity(1, 2).links(facet)[0] for facet in facets], dtype=np.int64)
    geometry = fem.geometry_dofmap(mesh)[cells]
    of_facets = fem.corners_of_facets(mesh, facets, 2)
    on = (geometry[:, :, None] == of_facets[:, None, :]).any(axis=2)
    corner = np.nonzero(on)[1].reshape(-1, 2)
    inputs = mesh.geometry.input_global_indices[np.take_along_axis(geometry, corner, axis=1)]
    # In the order of the input, so that rounding is the same on any number of ranks.
    corner = np.take_along_axis(corner, np.argsort(inputs, axis=1), axis=1)
    ends = mesh.geometry.x[:, :2][np.take_along_axis(geometry, corner, axis=1)]
    opposite = mesh.geometry.x[:, :2][geometry[np.arange(len(cells)), 3 - corner.sum(axis=1)]]
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    inward = np.sum(normal * (opposite - ends[:, 0]), axis=1) > 0
    normal[inward] *= -1
    values = np.take_along_axis(nodes.space.dofmap.list[cells], corner, axis=1)
    middles = np.stack([0.75 * ends[:, i] + 0.25 * ends[:, 1 - i] for i in (0, 1)], axis=1)
    _, first, count = np.unique(values, return_index=True, return_counts=True)
    error = None
    if np.any(count > 1):
        x = ", ".join(f"{value:.6g}" for value in ends.reshape(-1, 2)[first[np.argmax(count)]])
        error = RuptfxError(
            f"interface '{side}' at ({x}) m: a triangle has two sides on it, and with [fracture] every corner has one "
            "partner; refine the mesh there, or round the interface"
        )
    parallel.raise_on_all(nodes.comm, error)
    return _FacetEnds(values.ravel(), middles.reshape(-1, 2), np.repeat(normal, 2, axis=0), np.repeat(0.5 * length, 2))


def _pair(
    at_plus: np.ndarray, at_minus: np.ndarray, plus: np.ndarray, minus: np.ndarray, name: str, extent: float
) -> tuple[np.ndarray, np.ndarray, Exception | None]:
    """Return pairs of nodes of the two sides at the same position, and an error if one has no partner."""
    if len(plus) == 0 and len(minus) == 0:
        return plus, minus, None
    if len(plus) == 0 or len(minus) == 0:
        return plus, minus, RuptfxError(f"interface '{name}': this rank has one side only (a fault of the partition)")
    distance, partner = closest(at_plus, at_minus)
    lonely = int(np.argmax(distance))
    if distance[lonely] > 1e-8 * extent or len(plus) != len(minus):
        where = ", ".join(f"{value:.6g}" for value in at_plus[lonely])
        return (
            plus,
            minus,
            RuptfxError(
                f"interface '{name}': the nodes of the two sides do not match ({len(plus)} on the plus, "
                f"{len(minus)} on the minus side; the plus node at ({where}) m is {distance[lonely]:.3g} m from "
                "its nearest partner). "
                "Mesh both sides with the same nodes along the interface"
            ),
        )
    return plus, minus[partner], None


def _areas(nodes: Nodes, tags: tuple[int, ...], chosen: np.ndarray) -> np.ndarray:
    """Return area, and area times normal out of the minus body, of chosen nodes, shape (n, 1 + dim).

    They are summed over facets, ranks and tied nodes.
    """
    space, mesh, ufl = nodes.space, nodes.space.mesh, fem.ufl
    dim, components = mesh.geometry.dim, space.dofmap.index_map_bs
    ds = ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=nodes.bodies.facets,
        subdomain_id=tags,
        metadata=fem.gll_metadata(mesh, space.element.basix_element.degree),
    )
    test, n = ufl.TestFunction(space), ufl.FacetNormal(mesh)

    def nodal(form: ufl.Form) -> np.ndarray:
        vector = fem.assemble_summed(space, form)
        nodes.sum_tied(vector)
        return vector.reshape(-1, components)[chosen]

    if components == 1:
        weight = nodal(test * ds)[:, 0]
        normal = np.stack([nodal(n[i] * test * ds)[:, 0] for i in range(dim)], axis=1)
    else:
        # A section that repeats along strike has a third component of displacement and two of the normal.
        more = [0.0] * (components - dim)
        weight = nodal(ufl.inner(ufl.as_vector([1.0] * dim + more), test) * ds)[:, 0]
        normal = nodal(ufl.inner(ufl.as_vector([*n, *more]) if more else n, test) * ds)[:, :dim]
    return np.column_stack([weight, normal])


def local_frame(normal: np.ndarray, mean: np.ndarray | None = None, strike: int | None = None) -> np.ndarray:
    """Return rows normal and tangents of every point, shape (n, dim, dim).

    On a surface the first tangent of the mean normal is horizontal and the second points down dip, as on an extruded
    line; on horizontal surfaces the first is +x. Tangents of points are the projections of the first one, so that they
    change continuously along a curved surface.

    Parameters
    ----------
    normal : ndarray, shape (n, dim)
    mean : ndarray, shape (dim,), optional
        Mean normal of the surface, the first normal without it.
    strike : int, optional
        Axis that is the first tangent everywhere.
    """
    if strike is not None:
        first = np.tile(np.eye(3)[strike], (len(normal), 1))
        return np.stack([normal, first, np.cross(normal, first)], axis=1)
    if normal.shape[1] == 2:
        return np.stack([normal, np.stack([normal[:, 1], -normal[:, 0]], axis=1)], axis=1)
    mean = normal[0] if mean is None else mean
    x, y, _ = mean
    along = np.array([y, -x, 0.0]) / np.hypot(x, y) if np.hypot(x, y) > HORIZONTAL else np.array([1.0, 0.0, 0.0])
    aligned = np.abs(normal @ along) > ALIGNED
    toward = np.where(aligned[:, None], np.cross(mean, along), along)
    first = toward - normal * np.sum(normal * toward, axis=1, keepdims=True)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


def order_points(
    comm: fem.MPI.Comm,
    points: np.ndarray,
    owned: np.ndarray,
    normal: np.ndarray,
    reference: np.ndarray | None,
    strike: int | None = None,
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray, int, Line, np.ndarray]:
    """Return positions and global index of points, number of all points, definition of positions, mean normal.

    Positions are those along the interface and across it.

    Parameters
    ----------
    comm : MPI communicator
    points, normal : ndarray, shape (n, dim)
    owned : ndarray of bool, shape (n,)
    reference : ndarray, shape (dim,), optional
        Normal of the plane in which the positions of a rough surface are; without it the mean normal is.
    strike : int, optional
        Axis along which positions are; they are its coordinates.
    """
    everything = parallel.share_rows(comm, np.hstack([points, normal])[owned])
    places, normals = np.split(everything, 2, axis=1)
    mean = normals.mean(axis=0)
    size = np.linalg.norm(mean)
    mean = mean / size if size > CLOSED else np.eye(len(mean))[-1]
    if reference is not None:
        mean = reference / np.linalg.norm(reference) * np.sign(reference @ mean)
    frame, extent = local_frame(mean[None], strike=strike)[0], np.ptp(places, axis=0).max()
    along = frame[1]
    # Order along the mean tangent, then by the other coordinates: independent of the number of ranks.
    keys = np.round(np.stack([places @ along, *places.T[::-1]]) / extent, 9)
    places = places[np.lexsort(keys[::-1])]
    x_axis = np.eye(len(along))[0]
    origin = places[0] if strike is None else places[0] * (1 - along)
    measure: Measure
    flat = reference is not None or np.ptp(places @ mean) < FLAT * extent
    if flat and np.abs(along - x_axis).max() < FLAT:
        measure, position, origin = "x", places[:, 0], np.where(x_axis, 0.0, origin)
    elif len(along) == 2:
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        measure, position = "arc length", np.concatenate([[0.0], np.cumsum(steps)])
    else:
        measure, position = "first tangent", (places - origin) @ along
    line = Line(measure, origin, float(position[0]), float(position[-1]))
    across = None
    if len(along) == 3:
        down = places @ frame[2]
        across = _rounded(down - down.min(), extent)
    if len(points) == 0:
        none = np.zeros(0)
        return none, None if across is None else none, np.zeros(0, dtype=np.int64), len(places), line, mean
    _, number = closest(points, places)
    return position[number], None if across is None else across[number], number, len(places), line, mean
