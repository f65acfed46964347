"""Stacked rectangles of quadrilaterals with common columns: any rank can make any part of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ruptfx.bodies.meshes import RawMesh
from ruptfx.input.schema import CaseError

MOST_ELEMENTS = 100_000_000  # a mesh of 3e9 unknowns at order 4: more is a mistake
FEWEST_ROWS = 3  # of a block: the two at an interface, and one that may move to another rank


@dataclass(frozen=True)
class Lattice:
    """Stacked rectangular bodies from top to bottom, with interfaces between them.

    Vertices are numbered body by body, in each of them column by column from below; cells likewise.

    Attributes
    ----------
    x : ndarray, shape (columns + 1,)
        [m], increasing.
    levels : dict of str to ndarray, shape (rows + 1,)
        Heights of the vertices of every body [m], increasing.
    interfaces : tuple of str
        Name of the interface above each body after the first.
    one_sided : dict of str to str
        Kind of the interface below the lowest body, if there is one, as in `RawMesh`.
    chamfer : float
        Length and height cut off the lower corners of the lowest body [m]; a level of it, or zero.
    """

    x: np.ndarray
    levels: dict[str, np.ndarray]
    interfaces: tuple[str, ...] = ()
    one_sided: dict[str, str] = field(default_factory=dict)
    reference_normals: ClassVar[dict[str, np.ndarray]] = {}
    mirror_planes: ClassVar[dict[str, str]] = {}
    chamfer: float = 0.0
    cell: ClassVar[str] = "quadrilateral"
    most_blocks: ClassVar[int] = 1  # along y where a rank has two columns only; more are not worth it

    def __post_init__(self) -> None:
        affordable(self.columns * sum(self.rows))

    @property
    def columns(self) -> int:
        return len(self.x) - 1

    @property
    def bodies(self) -> list[str]:
        return list(self.levels)

    @property
    def rows(self) -> list[int]:
        """Number of element rows of every body."""
        return [len(y) - 1 for y in self.levels.values()]

    @property
    def vertices(self) -> int:
        return int(self._first_vertex[-1])

    @property
    def _first_vertex(self) -> np.ndarray:
        """First vertex of every body, and the number of all vertices, shape (bodies + 1,)."""
        return np.concatenate([[0], np.cumsum([len(self.x) * (rows + 1) for rows in self.rows])])

    @property
    def sides(self) -> dict[str, tuple[int, str]]:
        """Body and side of every edge and of the meshed sides of interfaces, ``"main.plus"``."""
        last, result = len(self.levels) - 1, {}
        for number, body in enumerate(self.bodies):
            for side in ("left", "right", "top", "bottom"):
                if (side == "top" and number > 0) or (side == "bottom" and (number < last or self.one_sided)):
                    continue
                result[f"{body}.{side}"] = number, side
        for number, name in enumerate(self.interfaces):
            result |= {f"{name}.plus": (number, "bottom"), f"{name}.minus": (number + 1, "top")}
        return result | {f"{name}.plus": (last, "bottom") for name in self.one_sided}

    def points(self, vertices: np.ndarray) -> np.ndarray:
        """Return coordinates of vertices [m], shape (vertices, 2)."""
        body, column, row = self._places(vertices)
        points = np.empty((len(vertices), 2))
        points[:, 0] = self.x[column]
        for number, y in enumerate(self.levels.values()):
            points[body == number, 1] = y[row[body == number]]
        if self.chamfer:
            lowest = body == len(self.levels) - 1
            points[lowest, 0] = self._drawn_in(*points[lowest].T)
        return points

    def _drawn_in(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return x of vertices near the chamfer, compressed within three times its length [m]."""
        y = y - next(reversed(self.levels.values()))[0]
        left, right = self.x[0], self.x[-1]
        reach = min(3 * self.chamfer, 0.5 * (right - left))
        cut = np.maximum(self.chamfer - y, 0.0)
        near_left, near_right = (np.maximum(1 - away / reach, 0.0) for away in (x - left, right - x))
        return x + cut * (near_left - near_right)

    def body_of(self, vertices: np.ndarray) -> np.ndarray:
        """Return the body index of every vertex."""
        return np.searchsorted(self._first_vertex, vertices, side="right") - 1

    def body_of_cells(self, cells: np.ndarray) -> np.ndarray:
        """Return the body index of cells, given by their vertices."""
        return self.body_of(cells[:, 0])

    def nodes(self, order: int) -> int:
        """Return the number of nodes of elements of an order."""
        return sum((self.columns * order + 1) * (rows * order + 1) for rows in self.rows)

    def ties(self, tied: Mapping[str, tuple[str, str]]) -> dict[str, np.ndarray] | None:
        """Return the shifts [m] of tied edges by key; None if they are not opposite ends that parts can keep together.

        Parameters
        ----------
        tied : dict of str to (str, str)
            First and second edge, by key of the case.
        """
        height = max(y[-1] for y in self.levels.values()) - min(y[0] for y in self.levels.values())
        size = {"x": np.array([np.ptp(self.x), 0.0]), "y": np.array([0.0, height])}
        faces = {f"{name}.{side}" for name in (*self.interfaces, *self.one_sided) for side in ("plus", "minus")}
        shifts = {}
        for key, (first, second) in tied.items():
            here, there = (self.sides.get(edge, (-1, "")) for edge in (first, second))
            if here[0] == there[0] and {here[1], there[1]} == {"left", "right"}:
                shifts[key] = size["x"] if there[1] == "right" else -size["x"]
            elif {here[1], there[1]} == {"top", "bottom"} and {first, second} <= set(self.sides) - faces:
                shifts[key] = size["y"] if there[1] == "top" else -size["y"]
            else:
                return None
        return shifts

    def side_of(self, facets: np.ndarray) -> np.ndarray:
        """Return the index in `sides` of every boundary facet, shape (facets, 2), -1 where it has no name."""
        body, column, row = (part.reshape(facets.shape) for part in self._places(facets.ravel()))
        top = np.array(self.rows, dtype=np.int64)[body]
        on = {"left": column == 0, "right": column == self.columns, "bottom": row == 0, "top": row == top}
        values = np.full(len(facets), -1)
        for place, (number, side) in enumerate(self.sides.values()):
            values[(on[side] & (body == number)).all(axis=1)] = place
        return values

    def cells(self, body: int, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return vertices of the cells of the given columns and rows in tensor order, shape (cells, 4)."""
        height = self.rows[body] + 1
        corner = (self._first_vertex[body] + columns[:, None] * height + rows).ravel()
        return np.stack([corner, corner + height, corner + 1, corner + height + 1], axis=1)

    def part(self, part: int, parts: int, wrapped: bool = False, upright: bool = False) -> np.ndarray:
        """Return vertices of the cells of one of several parts, shape (cells, 4).

        Parts have about the same size and short outlines, and contain both sides of an interface.

        Parameters
        ----------
        part, parts : int
            Index of the part and number of parts, at most one per column.
        wrapped : bool
            Put the first and the last column into the same part.
        upright : bool
            Let every part span the full height, so that the uppermost and the lowest row are in the same part.
        """
        stack = list(range(len(self.levels)))[::-1]  # bodies from below
        first_row = np.concatenate([[0], np.cumsum([self.rows[body] for body in stack])])
        total = int(first_row[-1])
        across, along = split(parts, self.columns - wrapped, 1 if upright else max(1, total // FEWEST_ROWS), total)
        bounds = np.arange(along + 1) * total // along
        bounds[1:-1] += np.isin(bounds[1:-1], first_row)  # never along an interface
        shift = max(1, self.columns // (2 * across)) if wrapped else 0
        strip = (np.arange(self.columns) + shift) % self.columns * across // self.columns
        columns = np.flatnonzero(strip == part % across)
        low, high = bounds[part // across], bounds[part // across + 1]
        items = []
        for body in range(len(self.levels)):
            begin = int(first_row[stack.index(body)])
            rows = np.arange(max(low - begin, 0), min(high - begin, self.rows[body]))
            items.append(self.cells(body, columns, rows))
        return np.concatenate(items)

    def build(self) -> RawMesh:
        """Return the whole mesh."""
        lines = {name: self._side(number, side) for name, (number, side) in self.sides.items()}
        named = {name: np.stack([line[:-1], line[1:]], axis=1) for name, line in lines.items()}
        faces = [*self.interfaces, *self.one_sided]
        pairs = {name: (named[f"{name}.plus"], named[f"{name}.{self._minus(name)}"]) for name in faces}
        sides = {f"{name}.{side}" for name in faces for side in ("plus", "minus")}
        return RawMesh(
            cell="quadrilateral", points=self.points(np.arange(self.vertices)), cells=self.part(0, 1),
            bodies=self.bodies, cell_body=np.repeat(np.arange(len(self.rows)), [self.columns * n for n in self.rows]),
            edges={name: facets for name, facets in named.items() if name not in sides}, interfaces=pairs,
            one_sided=self.one_sided,
        )  # fmt: skip

    def _minus(self, interface: str) -> str:
        return "plus" if interface in self.one_sided else "minus"

    def _side(self, body: int, side: str) -> np.ndarray:
        """Return the vertices along a side."""
        first, rows = self._first_vertex[body], self.rows[body]
        number = first + np.arange(len(self.x) * (rows + 1)).reshape(len(self.x), rows + 1)
        return {"left": number[0], "right": number[-1], "bottom": number[:, 0], "top": number[:, -1]}[side]

    def _places(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return body, column and row of vertices."""
        body = self.body_of(vertices)
        height = np.array(self.rows, dtype=np.int64)[body] + 1
        column, row = np.divmod(vertices - self._first_vertex[body], height)
        return body, column, row


def split(parts: int, columns: int, most: int, rows: int) -> tuple[int, int]:
    """Return numbers of blocks along x and y with product `parts` and shortest cuts, at most `most` along y.

    Blocks of two columns and more are preferred.
    """
    ways = [(parts // along, along) for along in range(1, min(parts, most) + 1) if parts % along == 0]
    wide = [way for way in ways if 2 * way[0] <= columns]
    fits = wide or [way for way in ways if way[0] <= columns]
    return min(fits, key=lambda way: (way[0] - 1) * rows + (way[1] - 1) * columns)


def affordable(elements: float) -> int:
    """Return a rounded number of elements; refuse a number beyond the limit.

    Raises
    ------
    CaseError
    """
    if elements > MOST_ELEMENTS:
        raise CaseError(f"mesh.element_size: {elements:.3g} elements, at most {MOST_ELEMENTS:.0e}; make them larger")
    return max(1, round(elements))


def columns_of(left: float, length: float, size: float) -> np.ndarray:
    """Return the ends of columns of about the same width [m]."""
    return left + np.linspace(0, length, affordable(length / size) + 1)


def row_levels(height: float, size: float, growth: float) -> np.ndarray:
    """Return heights of element rows that begin with `size` and grow by a factor, scaled to end at `height` [m]."""
    if growth == 1:
        return np.linspace(0, height, affordable(height / size) + 1)
    # n rows are size (growth^n - 1) / (growth - 1) high together.
    rows = np.ceil(np.log1p(height / size * (growth - 1)) / np.log(growth) * (1 - 1e-12))
    heights = np.concatenate([[0.0], np.cumsum(size * growth ** np.arange(affordable(rows)))])
    return heights * height / heights[-1]


def graded(length: float, size: float, growth: float, fine: float) -> np.ndarray:
    """Return distances of planes of vertices from 0: even ones up to `fine`, then growing ones, up to `length` [m]."""
    near = even(min(fine, length), size) if fine else np.zeros(1)
    outer_length = length - near[-1]
    if outer_length <= 0.5 * size:
        return near
    return np.concatenate([near, near[-1] + row_levels(outer_length, size, growth)[1:]])


def even(length: float, size: float) -> np.ndarray:
    """Return the planes of even elements, not larger than `size`, over a length [m]."""
    return np.linspace(0, length, affordable(np.ceil(length / size * (1 - 1e-9))) + 1)
