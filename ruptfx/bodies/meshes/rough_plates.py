"""Two plates with rough surfaces, one on the other, each with its own elements, in the plane or as solids."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import affordable, columns_of, graded, row_levels
from ruptfx.bodies.meshes.lobatto import nodes_between
from ruptfx.input.profiles import Profile, evaluate
from ruptfx.input.profiles.places import Place, located
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import Coordinate, Length, VaryingHeight

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Interval = tuple[float, float]
SAMPLES = {1: 20, 2: 4}  # points per element along each direction at which the gap of lines and surfaces is evaluated
SIDES = (("left", "right"), ("front", "back"), ("bottom", "top"))
"""Names of the sides across x, y and the vertical, which is y in the plane."""


class RoughPlate(Part):
    """One of the plates."""

    length: Length
    """Along x."""
    height: Length
    """Height without the roughness."""
    element_size: Length
    """Along the surface, and across it next to the surface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the sizes of neighbouring elements away from the surface, and beyond `fine`."""
    left: Coordinate = 0.0
    """x of the left end."""
    width: Length | None = None
    """Along y, of a solid: then z is up, and the profile varies over x and y."""
    front: Coordinate = 0.0
    """y of the front of a solid."""
    fine: Length | None = None
    """Length and width in the middle of the plate in which elements have their size; left out, it is the plate."""
    profile: VaryingHeight = 0.0
    """Height of the surface, upwards, by x, or x and y; its effect on the mesh decays within the plate."""

    @property
    def intervals(self) -> list[Interval]:
        """First and last x, and y of a solid [m]."""
        along = (self.left, self.left + self.length)
        return [along] if self.width is None else [along, (self.front, self.front + self.width)]

    def heights(self, places: Floats, key: str) -> Floats:
        """Return the height of the surface at x, shape (n,), or x and y, shape (n, 2) [m]; shape (n,).

        Raises
        ------
        CaseError
            If the profile is not defined there.
        """
        try:
            return np.asarray(evaluate(in_plan(self.profile, places.ndim), places), dtype=float)
        except CaseError as error:
            raise CaseError(f"{key}.profile: {error}") from None

    def build(self, order: int, side: int, key: str) -> tuple[Floats, Integers, dict[str, Integers]]:
        """Return points, cells (vertices first), and the facets of all sides by vertices in tensor order.

        Parameters
        ----------
        order : int
            Order of the curved cells.
        side : int
            1 where the plate is above its surface, -1 below.
        key : str
            Key of the plate, for messages.
        """
        ends = [self._ends(self.left, self.length)]
        if self.width is not None:
            ends.append(self._ends(self.front, self.width))
        levels = row_levels(self.height, self.element_size, self.growth)
        affordable(float(np.prod([len(each) - 1.0 for each in (*ends, levels)])))
        axes = [nodes_between(each, order) for each in ends]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        away = nodes_between(levels, order)
        rows = places.reshape(-1, len(axes))
        height = self.heights(rows if len(axes) > 1 else rows[:, 0], key).reshape(places.shape[:-1])
        depth = min(self.height, max(3 * levels[1], 3 * np.abs(height).max()))
        part = np.minimum(away / depth, 1.0)
        fading = 1 - part**3 * (10 - 15 * part + 6 * part**2)
        up = side * away + height[..., None] * fading
        if side < 0:
            up = up[..., ::-1]
        points = np.concatenate(
            [np.broadcast_to(places[..., None, :], (*up.shape, len(axes))), up[..., None]], axis=-1
        ).reshape(-1, len(axes) + 1)
        number = np.arange(len(points)).reshape(up.shape)
        corner = number[(slice(None, None, order),) * number.ndim]
        facets = {
            name: _tiles(corner.take(end, axis), _corners(corner.ndim - 1, 1), 1)
            for axis, names in enumerate((*SIDES[: len(axes)], SIDES[2]))
            for name, end in zip(names, (0, -1), strict=True)
        }  # fmt: skip
        return points, _tiles(number, _places(number.ndim, order), order), facets

    def _ends(self, first: float, length: float) -> Floats:
        """Return the ends of the elements along one direction [m]."""
        if self.fine is None or self.fine >= length:
            return columns_of(first, length, self.element_size)
        half = graded(0.5 * length, self.element_size, self.growth, 0.5 * self.fine)
        return np.asarray(first + 0.5 * length + np.concatenate([-half[:0:-1], half]))


class RoughPlates(MeshSource):
    """Two plates of structured, curved elements, `upper` above `lower`, whose surfaces are profiles.

    They may differ in length, position, elements and roughness; the interface `main` between them needs the table
    `[faults.main.sliding]`. The upper plate is shifted so that the smallest gap of the surfaces is `closest`. The
    edges are `upper.left`, `upper.right`, `upper.top`, `lower.left`, `lower.right` and `lower.bottom`. Plates with a
    `width` are solids of hexahedra, z is up, and they have the edges `.front` (lowest y) and `.back`, too.
    """

    example: ClassVar[str] = (
        '{ kind = "rough_plates", closest = 1e-4, curve_order = 2, '
        "upper = { length = 4e-3, height = 1e-3, element_size = 1e-3 }, "
        "lower = { length = 4e-3, height = 1e-3, element_size = 0.5e-3, "
        'profile = { kind = "sinusoid", amplitude = 5e-5, wavelength = 2e-3 } } }'
    )

    upper: RoughPlate
    """Upper plate; its lower side has the points of the interface."""
    lower: RoughPlate
    """Lower plate; its upper side is the opposite surface."""
    curve_order: Annotated[int, Field(ge=1, le=8)] = 4
    """Order of the polynomials that follow the profiles; not above the order of the displacement."""
    closest: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Smallest gap between the two surfaces."""

    @model_validator(mode="after")
    def _alike(self) -> RoughPlates:
        widths = [plate.width for plate in (self.upper, self.lower)]
        if None in widths and widths != [None, None]:
            name, other = ("upper", "lower") if widths[0] is None else ("lower", "upper")
            raise ValueError(
                f"{name}.width is missing and {other}.width = {self.lower.width or self.upper.width:g} m: both plates "
                "are solids, or none is; add it, or remove the other"
            )
        return self

    def build(self) -> RawMesh:
        upper, upper_cells, upper_sides = self.upper.build(self.curve_order, 1, "mesh.upper")
        lower, lower_cells, lower_sides = self.lower.build(self.curve_order, -1, "mesh.lower")
        upper[:, -1] += self.closest - self._least_distance()
        shift = len(upper)
        edges = {f"upper.{side}": facets for side, facets in upper_sides.items() if side != "bottom"}
        edges |= {f"lower.{side}": facets + shift for side, facets in lower_sides.items() if side != "top"}
        solid = upper.shape[1] == 3
        return RawMesh(
            cell="hexahedron" if solid else "quadrilateral", points=np.concatenate([upper, lower]),
            cells=np.concatenate([upper_cells, lower_cells + shift]), bodies=["upper", "lower"],
            cell_body=np.repeat([0, 1], [len(upper_cells), len(lower_cells)]), edges=edges,
            interfaces={"main": (upper_sides["bottom"], lower_sides["top"] + shift)}, non_matching={"main"},
            reference_normals={"main": np.array([0.0, 0.0, 1.0])} if solid else {}, order=self.curve_order,
        )  # fmt: skip

    def _least_distance(self) -> float:
        """Return the smallest gap of the unshifted profiles, over the overlap of the plates [m]."""
        common = overlap(
            self.upper.intervals, self.lower.intervals, ("upper", "lower"), ("mesh.upper.left", "mesh.upper.front")
        )
        size = min(plate.element_size for plate in (self.upper, self.lower))

        def gap(places: Floats) -> Floats:
            return self.upper.heights(places, "mesh.upper") - self.lower.heights(places, "mesh.lower")

        return least(gap, common, size)


def in_plan(profile: object, dim: int) -> object:
    """Return a profile whose points are their positions x, or x and y if `dim` is 2."""
    if not isinstance(profile, Profile):
        return profile

    def position(_: str, place: Place) -> object:
        return place.x if dim == 1 else np.array([place.x, place.y])

    return located(profile, position, "profile")


def overlap(
    ours: Sequence[Interval], others: Sequence[Interval], names: tuple[str, str], keys: Sequence[str]
) -> list[Interval]:
    """Return the common part of the extents of two bodies along x, or x and y [m].

    Parameters
    ----------
    names : (str, str)
        Names of the bodies, for messages.
    keys : sequence of str
        Key of a position along x, and along y.

    Raises
    ------
    CaseError
        One is beside the other.
    """
    common = []
    for (first, last), (begin, end), key in zip(ours, others, keys, strict=False):
        if max(first, begin) >= min(last, end):
            position = begin if names[1] in key else first
            raise CaseError(
                f"{key} = {position:g}: the bodies are beside each other ({names[0]} from {first:g} to {last:g} m, "
                f"{names[1]} from {begin:g} to {end:g} m); put one on the other"
            )
        common.append((max(first, begin), min(last, end)))
    return common


def least(gap: Callable[[Floats], Floats], extent: Sequence[Interval], size: float) -> float:
    """Return the smallest value of a function over an interval or a rectangle.

    Parameters
    ----------
    gap : callable
        Values at positions of shape (n,) or (n, 2) [m].
    size : float
        Length of elements [m], of which several samples are taken; on a rectangle the surroundings of the least one
        are sampled more closely.
    """
    samples = SAMPLES[len(extent)]
    counts = [affordable(samples * (last - first) / size) for first, last in extent]
    affordable(float(np.prod([float(count) for count in counts])))
    axes = [np.linspace(first, last, count + 1) for (first, last), count in zip(extent, counts, strict=True)]
    if len(axes) == 1:
        return float(np.min(gap(axes[0])))
    for _ in range(3):
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        values = gap(places)
        lowest = places[np.argmin(values)]
        axes = [
            np.linspace(max(middle - step, first), min(middle + step, last), 2 * SAMPLES[1] + 1)
            for middle, (first, last), step in zip(lowest, extent, (axis[1] - axis[0] for axis in axes), strict=True)
        ]
    return float(values.min())


def _corners(dim: int, order: int) -> list[tuple[int, ...]]:
    """Return the positions of the vertices of a cell in a lattice of its nodes, the first direction fastest."""
    return [place[::-1] for place in product((0, order), repeat=dim)]


def _places(dim: int, order: int) -> list[tuple[int, ...]]:
    """Return the positions of the nodes of a cell in a lattice, in the order of DOLFINx.

    Vertices, then the inner nodes of edges, of faces and of the cell; the parts of one dimension are sorted by their
    vertices, and the first direction is fastest in each.
    """
    parts = []
    for way in product(((0,), (order,), tuple(range(1, order))), repeat=dim):
        free = [axis for axis in range(dim) if way[axis] not in ((0,), (order,))]
        vertices = sorted(
            sum(2**axis for axis in range(dim) if corner[axis])
            for corner in _corners(dim, 1)
            if all(axis in free or corner[axis] == (way[axis] == (order,)) for axis in range(dim))
        )
        parts.append((len(free), vertices, [place[::-1] for place in product(*way[::-1])]))
    return [place for _, _, places in sorted(parts) for place in places]


def _tiles(number: Integers, places: Sequence[tuple[int, ...]], order: int) -> Integers:
    """Return the nodes of cells or facets by their positions in a lattice of nodes, shape (cells, positions)."""
    counts = [(size - 1) // order for size in number.shape]
    return np.stack([
        number[tuple(slice(first, first + count * order, order) for first, count in zip(place, counts, strict=True))]
        .ravel() for place in places
    ], axis=1)  # fmt: skip
