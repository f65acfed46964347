"""Interpolation between points."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo, field_validator, model_validator

from ruptfx.input.number_files import with_file_read
from ruptfx.input.profiles import Profile, Value
from ruptfx.input.profiles.places import Position
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError


class Table(Profile):
    """Interpolation between given points, which cover the interface or body unless `extend` is set."""

    example: ClassVar[str] = '{ kind = "table", positions = [-1.0, 0.0, 2.0], values = [0.0, 1.0, 3.0] }'
    interpolation: Literal["linear", "cubic"] = "linear"
    """`cubic`: the spline whose curvature is continuous (not-a-knot ends), for measured surfaces."""
    positions: list[Position] = []
    """Positions, at least two, increasing."""
    values: list[Value] = []
    """One for each position."""
    extend: bool = False
    """Continue the first and the last value beyond the ends."""
    file: str | None = None
    """CSV file with two columns, position and value, instead of the lists; relative to the case file. Its header may
    give the units, as in `x (mm), stress (MPa)`; default are m and the unit of the key. The resolved case contains the
    numbers."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        return with_file_read(values, info, "positions", "position", ("m", unit))

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, values: object, info: ValidationInfo) -> object:
        """Read the file of a table created in Python, without a key."""
        return with_file_read(values, info, "positions", "position", ("m", None))

    @field_validator("positions")
    @classmethod
    def _increasing(cls, positions: list[float]) -> list[float]:
        if len(positions) < 2 or np.any(np.diff(positions) <= 0):
            raise ValueError("positions must increase and be at least two")
        return positions

    @model_validator(mode="after")
    def _matching(self) -> Table:
        if len(self.values) != len(self.positions):
            raise ValueError(f"values: there are {len(self.values)}, each of {len(self.positions)} positions needs one")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        first, last = self.positions[0], self.positions[-1]
        slack = 1e-9 * (last - first)  # rounding of coordinates
        if not self.extend and len(position) and not first - slack <= position.min() <= position.max() <= last + slack:
            low, high = at_most(position.min() + slack), at_least(position.max() - slack)
            raise CaseError(
                f"the table from {first:.6g} to {last:.6g} m does not cover the interface or body, which has "
                f"points from {low} to {high} m; add to the table, or set extend = true to go on with its first and "
                "last value"
            )
        if self.interpolation == "cubic":
            from scipy.interpolate import CubicSpline

            return CubicSpline(self.positions, self.values)(np.clip(position, first, last))
        return np.interp(position, self.positions, self.values)
