"""Two rectangular plates, one on the other."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.meshes import MeshSource, RawMesh
from ruptfx.schema import CaseError, Unit
from ruptfx.units import Coordinate, Length

MOST_ELEMENTS = 100_000_000


class TwoPlates(MeshSource):
    """Two rectangular plates of structured quadrilaterals that meet at y = 0, `upper` above `lower`.

    The interface is called `main`; the edges are `upper.left`, `upper.right`, `upper.top`, `lower.left`,
    `lower.right` and `lower.bottom`.
    """

    example: ClassVar[str] = '{ kind = "two_plates", length = 12e-3, height = 4e-3, element_size = 1e-3, growth = 1.3 }'

    length: Length
    """Along x."""
    height: Length
    """Of each plate."""
    element_size: Length
    """Along the interface, and across it next to the interface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the heights of neighbouring elements away from the interface."""
    left: Coordinate = 0.0
    """x of the left end."""

    def levels(self) -> np.ndarray:
        """Heights of the element rows above the interface, shape (rows + 1,) [m]."""
        return row_levels(self.height, self.element_size, self.growth)

    def build(self) -> RawMesh:
        x = self.left + np.linspace(0, self.length, affordable(self.length / self.element_size) + 1)
        levels = self.levels()
        upper, upper_cells, upper_sides = grid(x, levels)
        lower, lower_cells, lower_sides = grid(x, -levels[::-1])
        shift = len(upper)
        return RawMesh(
            cell="quadrilateral", points=np.concatenate([upper, lower]),
            cells=np.concatenate([upper_cells, lower_cells + shift]), bodies=["upper", "lower"],
            cell_body=np.repeat([0, 1], [len(upper_cells), len(lower_cells)]),
            edges={
                **{f"upper.{side}": upper_sides[side] for side in ("left", "right", "top")},
                **{f"lower.{side}": lower_sides[side] + shift for side in ("left", "right", "bottom")},
            },
            interfaces={"main": (upper_sides["bottom"], lower_sides["top"] + shift)},
        )  # fmt: skip


def affordable(elements: float) -> int:
    """A number of elements, rounded, if a mesh that is built on one rank can have so many.

    Raises
    ------
    CaseError
    """
    if elements > MOST_ELEMENTS:
        raise CaseError(f"mesh.element_size: {elements:.3g} elements, at most {MOST_ELEMENTS:.0e}; make them larger")
    return max(1, round(elements))


def row_levels(height: float, size: float, growth: float) -> np.ndarray:
    """Heights of element rows that begin with `size` and grow by a factor, scaled to end at `height` [m]."""
    if growth == 1:
        return np.linspace(0, height, affordable(height / size) + 1)
    # n rows are size (growth^n - 1) / (growth - 1) high together.
    rows = np.ceil(np.log1p(height / size * (growth - 1)) / np.log(growth) * (1 - 1e-12))
    heights = np.concatenate([[0.0], np.cumsum(size * growth ** np.arange(affordable(rows)))])
    return heights * height / heights[-1]


def grid(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Points, cells in tensor order and the facets of the four sides of a rectangle."""
    affordable((len(x) - 1) * (len(y) - 1))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(x), len(y))
    cells = np.stack([number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]], axis=-1).reshape(-1, 4)
    lines = {"left": number[0], "right": number[-1], "bottom": number[:, 0], "top": number[:, -1]}
    return points, cells, {side: np.stack([line[:-1], line[1:]], axis=1) for side, line in lines.items()}
