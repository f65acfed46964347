"""Interpolation over a grid of a surface."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from ruptfx.profiles import Profile, Value
from ruptfx.schema import CaseError, Unit


class SurfaceTable(Profile):
    """Bilinear interpolation of values on a grid of strike and dip, which covers the surface."""

    over_surface: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "surface_table", strike = [-1.0, 0.0, 2.0], dip = [-1.0, 1.0], '
        "values = [[0.0, 1.0, 3.0], [2.0, 2.0, 4.0]] }"
    )
    strike: Annotated[list[Annotated[float, Unit("m")]], Field(min_length=2)]
    """Positions along strike, increasing."""
    dip: Annotated[list[Annotated[float, Unit("m")]], Field(min_length=2)]
    """Positions down dip, increasing."""
    values: list[list[Value]]
    """A row for each position down dip, with a value for each along strike."""

    @field_validator("strike", "dip")
    @classmethod
    def _increasing(cls, positions: list[float]) -> list[float]:
        if np.any(np.diff(positions) <= 0):
            raise ValueError("positions must increase")
        return positions

    @model_validator(mode="after")
    def _matching(self) -> SurfaceTable:
        if [len(row) for row in self.values] != [len(self.strike)] * len(self.dip):
            raise ValueError(f"values: give {len(self.dip)} rows (dip) of {len(self.strike)} numbers (strike)")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        cells, parts = [], []
        for name, values, grid in zip(("strike", "dip"), position.T, (self.strike, self.dip), strict=True):
            slack = 1e-9 * (grid[-1] - grid[0])  # rounding of coordinates
            if len(values) and not grid[0] - slack <= values.min() <= values.max() <= grid[-1] + slack:
                raise CaseError(
                    f"the table has {name} from {grid[0]:.6g} to {grid[-1]:.6g} m, and the surface has points from "
                    f"{values.min():.6g} to {values.max():.6g} m; add to the table"
                )
            inside = np.clip(values, grid[0], grid[-1])
            cell = np.clip(np.searchsorted(grid, inside, side="right") - 1, 0, len(grid) - 2)
            cells.append(cell)
            parts.append((inside - np.take(grid, cell)) / np.take(np.diff(grid), cell))
        (i, k), (s, d), table = cells, parts, np.asarray(self.values)
        upper = (1 - s) * table[k, i] + s * table[k, i + 1]
        lower = (1 - s) * table[k + 1, i] + s * table[k + 1, i + 1]
        return (1 - d) * upper + d * lower
