"""A box of hexahedra with a rectangular fault, of which every rank can make its own part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ruptfx.bodies.meshes import FACETS, RawMesh
from ruptfx.bodies.meshes._lattice import FEWEST_ROWS, affordable, split
from ruptfx.input.profiles import evaluate

FIXED_POINT = 50  # iterations, of which each halves the error of heights at least


def _fading(part: np.ndarray) -> np.ndarray:
    """Return 1 at 0 and 0 at 1, with slopes of zero at both."""
    return np.asarray(0.5 * (1 + np.cos(np.pi * part)))


@dataclass(frozen=True)
class Bricks:
    """Hexahedra between planes, with a rectangle of one plane y = constant that is cut open.

    Vertices are numbered column by column along x, in each of them along y and then z; copies on the minus side of the
    fault come last. The rim of the fault inside of the box is not cut: both sides share its vertices.

    Attributes
    ----------
    x, y, z : ndarray
        Coordinates of the planes of vertices [m], increasing; z is up.
    plane : int
        Index in `y` of the plane of the fault.
    along, down : (int, int)
        Indices in `x` and `z` of the first and the last column and row of vertices of the fault.
    slope : float
        Horizontal distance over depth of a dipping fault: y is shifted by - slope z.
    half : bool
        The plane of the fault is the first one along y, and the body on the other side is its mirror image.
    height : Profile or float, optional
        Distance of a rough fault from its plane along y [m], over x and the distance down dip.
    topography : Profile or float, optional
        Height of the upper side [m], over x and y.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    plane: int
    along: tuple[int, int]
    down: tuple[int, int]
    slope: float = 0.0
    half: bool = False
    height: object = None
    topography: object = None
    cell: ClassVar[str] = "hexahedron"

    def __post_init__(self) -> None:
        affordable(self.columns * _rows(self)[0] * _rows(self)[1])

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies that are meshed."""
        return ["plus"] if self.half else ["plus", "minus"]

    @property
    def interfaces(self) -> tuple[str, ...]:
        """Interfaces with both sides meshed."""
        return () if self.half else ("main",)

    @property
    def one_sided(self) -> dict[str, str]:
        """Interfaces without a minus side, and how the mirror image moves."""
        return {"main": "antisymmetric"} if self.half else {}

    @property
    def mirror_planes(self) -> dict[str, str]:
        """Edge in which the plane of a mirrored interface continues."""
        return {"main": "plus.plane"} if self.half else {}

    @property
    def columns(self) -> int:
        """Number of elements along x."""
        return len(self.x) - 1

    @property
    def _whole(self) -> int:
        """Number of vertices without the copies."""
        return len(self.x) * len(self.y) * len(self.z)

    @cached_property
    def _cut(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Columns and rows of vertices that have a copy, each as first and last."""
        ranges = []
        for (first, last), limit in ((self.along, self.columns), (self.down, _rows(self)[1])):
            ranges.append((first + (first > 0), last - (last < limit)))
        return ranges[0], ranges[1]

    @property
    def vertices(self) -> int:
        (a, b), (c, d) = self._cut
        return self._whole + (0 if self.half else (b - a + 1) * (d - c + 1))

    @property
    def sides(self) -> dict[str, tuple[int, str]]:
        """Body and side of every edge and of the meshed sides of the interface."""
        ends = ("left", "right", "bottom", "top", "far", *("plane",) * self.half)
        names = {f"{body}.{side}": (number, side) for number, body in enumerate(self.bodies) for side in ends}
        return names | {f"main.{body}": (number, "fault") for number, body in enumerate(self.bodies)}

    def _places(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return column, layer along y and row along z of vertices."""
        (a, _), (c, d) = self._cut
        column, remainder = np.divmod(vertices, len(self.y) * len(self.z))
        layer, row = np.divmod(remainder, len(self.z))
        copied = vertices >= self._whole
        i, k = np.divmod(vertices - self._whole, d - c + 1)
        return np.where(copied, a + i, column), np.where(copied, self.plane, layer), np.where(copied, c + k, row)

    def points(self, vertices: np.ndarray) -> np.ndarray:
        """Return coordinates of vertices [m], shape (vertices, 3)."""
        i, j, k = self._places(vertices)
        z = self.z[k]
        if self.topography is not None:  # rows follow it less and less, down to the plane bottom
            columns, column = np.unique(i * len(self.y) + j, return_inverse=True)
            z = z + rise(self, *np.divmod(columns, len(self.y)))[column.ravel()] * (1 - z / self.z[0])
        y = self.y[j] - self.slope * z
        return np.stack([self.x[i], y if self.height is None else y + _shift(self, self.height, i, j, k), z], axis=1)

    @property
    def reference_normals(self) -> dict[str, np.ndarray]:
        """Normal of the plane of a rough fault; none of a plane one."""
        return {} if self.height is None else {"main": np.array([0.0, 1.0, self.slope])}

    def body_of_cells(self, cells: np.ndarray) -> np.ndarray:
        """Return the body index of cells or facets, given by their vertices: 0 on the plus side."""
        layer = self._places(cells.ravel())[1].reshape(cells.shape)
        return np.where(self.half | (layer.max(axis=1) > self.plane), 0, 1)

    def nodes(self, order: int) -> int:
        """Return the number of nodes of elements of an order, without those of the fault's second side."""
        return int(np.prod([order * count + 1 for count in (self.columns, *_rows(self))]))

    def ties(self, tied: Mapping[str, tuple[str, str]]) -> dict[str, np.ndarray] | None:
        """Return None if edges are tied: parts do not keep opposite ends together; else an empty dict."""
        return None if tied else {}

    def side_of(self, facets: np.ndarray) -> np.ndarray:
        """Return the index in `sides` of every boundary facet, shape (facets, 4), -1 where it has no name."""
        i, j, k = (part.reshape(facets.shape) for part in self._places(facets.ravel()))
        body = self.body_of_cells(facets)
        on = {
            "left": i == 0, "right": i == self.columns, "bottom": k == 0, "top": k == _rows(self)[1],
            "far": (j == 0) & (not self.half) | (j == _rows(self)[0]), "plane": j == self.plane,
        }  # fmt: skip
        # A facet of the minus side has a copy among its vertices; those of the plus side have none.
        fault = (j == self.plane).all(axis=1)
        if self.half:  # the plane beyond the fault is a boundary, too
            for index, (first, last) in ((i, self.along), (k, self.down)):
                fault &= (index.min(axis=1) >= first) & (index.max(axis=1) <= last)
        copied = (facets >= self._whole).any(axis=1)
        values = np.full(len(facets), -1)
        for place, (number, side) in enumerate(self.sides.values()):
            chosen = fault & (copied == bool(number)) if side == "fault" else on[side].all(axis=1) & (body == number)
            values[chosen] = place
        return values

    @property
    def most_blocks(self) -> int:
        """Largest number of blocks along z."""
        return max(1, _rows(self)[1] // FEWEST_ROWS)

    def part(self, part: int, parts: int, wrapped: bool = False, upright: bool = False) -> np.ndarray:
        """Return vertices of the cells of one of several parts in tensor order, shape (cells, 8).

        Parts are blocks in x and z that span the whole width along y, and so contain both sides of the fault.

        Parameters
        ----------
        part, parts : int
            Index of the part and number of parts.
        wrapped : bool
            Put the first and the last column into the same part.
        upright : bool
            Blocks always span the full height.
        """
        across, along = split(parts, self.columns - wrapped, 1 if upright else self.most_blocks, _rows(self)[1])
        shift = max(1, self.columns // (2 * across)) if wrapped else 0
        slab = (np.arange(self.columns) + shift) % self.columns * across // self.columns
        columns = np.flatnonzero(slab == part % across)
        rows = np.flatnonzero(np.arange(_rows(self)[1]) * along // _rows(self)[1] == part // across)
        i, j, k = (each.ravel() for each in np.meshgrid(columns, np.arange(_rows(self)[0]), rows, indexing="ij"))
        (a, b), (c, d) = self._cut
        values = np.empty((len(i), 8), dtype=np.int64)
        for corner in range(8):
            x, y, z = i + corner % 2, j + corner // 2 % 2, k + corner // 4
            vertex = (x * len(self.y) + y) * len(self.z) + z
            # Without cells below the plane, in a half, nothing is copied.
            copied = (j < self.plane) & (y == self.plane) & (x >= a) & (x <= b) & (z >= c) & (z <= d)
            values[:, corner] = np.where(copied, self._whole + (x - a) * (d - c + 1) + z - c, vertex)
        return values

    def build(self) -> RawMesh:
        """Return the whole mesh."""
        cells = self.part(0, 1)
        facets = np.concatenate([cells[:, list(facet)] for facet in FACETS[self.cell]])
        side = self.side_of(facets)
        # A facet of the plane inside of the body has two cells, and is no side of the fault.
        i, _, k = (part.reshape(facets.shape) for part in self._places(facets.ravel()))
        inside = (i.min(axis=1) >= self.along[0]) & (i.max(axis=1) <= self.along[1])
        inside &= (k.min(axis=1) >= self.down[0]) & (k.max(axis=1) <= self.down[1])
        number = {name: place for place, name in enumerate(self.sides)}
        # In an order by column and row, the same for both sides.
        ordered = np.lexsort([k[:, 0], i[:, 0]])
        plus, minus = (
            facets[ordered[((side == number[f"main.{body}"]) & inside)[ordered]]]
            for body in (self.bodies[0], self.bodies[-1])
        )
        return RawMesh(
            cell=self.cell, points=self.points(np.arange(self.vertices)), cells=cells, bodies=self.bodies,
            cell_body=self.body_of_cells(cells),
            edges={name: facets[side == place] for name, place in number.items() if not name.startswith("main.")},
            interfaces={"main": (plus, minus)}, one_sided=self.one_sided,
            reference_normals=self.reference_normals, mirror_planes=self.mirror_planes,
        )  # fmt: skip


def _rows(bricks: Bricks) -> tuple[int, int]:
    """Return numbers of elements along y and z."""
    return len(bricks.y) - 1, len(bricks.z) - 1


def rise(bricks: Bricks, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return the height of the surface at columns of vertices [m], which follow a dipping fault up to it."""
    x, y, height = bricks.x[i], bricks.y[j], np.zeros(len(i))
    for _ in range(FIXED_POINT if bricks.slope else 1):
        height = evaluate(bricks.topography, np.stack([x, y - bricks.slope * height], axis=1))
    return height


def _shift(bricks: Bricks, height: object, i: np.ndarray, j: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Return how far along y vertices follow a rough fault [m]: less and less towards the sides of the box."""
    (left, right), (low, high) = bricks.along, bricks.down
    x, z, y = bricks.x[i], bricks.z[k], bricks.y[j] - bricks.y[bricks.plane]
    on_fault = np.clip(x, bricks.x[left], bricks.x[right]), np.clip(z, bricks.z[low], bricks.z[high])
    down = (bricks.z[high] - on_fault[1]) * np.hypot(1.0, bricks.slope)
    share = _fading(np.abs(y) / np.where(y < 0, -bricks.y[0], bricks.y[-1]))
    for beyond, first, last in (
        (x - on_fault[0], bricks.x[0] - bricks.x[left], bricks.x[-1] - bricks.x[right]),
        (z - on_fault[1], bricks.z[0] - bricks.z[low], bricks.z[-1] - bricks.z[high]),
    ):
        room = np.where(beyond < 0, -first, last)
        share = share * _fading(np.abs(beyond) / np.where(room > 0, room, 1.0))
    return evaluate(height, np.stack([on_fault[0], down], axis=1)) * share
