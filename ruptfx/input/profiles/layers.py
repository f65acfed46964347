"""Constant values between given positions."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from ruptfx.input.profiles import Profile, Value
from ruptfx.input.profiles.places import Position


class Layers(Profile):
    """Piecewise constant: one value below the first boundary, one between two boundaries, one beyond the last.

    In bodies every element takes the values of its own side of a boundary that follows the sides of elements.
    """

    example: ClassVar[str] = '{ kind = "layers", boundaries = [-0.3, 0.4], values = [1.0, 3.0, 2.0] }'
    boundaries: Annotated[list[Position], Field(min_length=1)]
    """Positions at which the value changes, increasing."""
    values: list[Value]
    """One more than boundaries, in the order of the positions."""

    @field_validator("boundaries")
    @classmethod
    def _increasing(cls, boundaries: list[float]) -> list[float]:
        if np.any(np.diff(boundaries) <= 0):
            raise ValueError("boundaries must increase")
        return boundaries

    @model_validator(mode="after")
    def _matching(self) -> Layers:
        if len(self.values) != len(self.boundaries) + 1:
            needed = len(self.boundaries) + 1
            raise ValueError(f"values: there are {len(self.values)}, {needed - 1} boundaries need {needed}")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return np.asarray(self.values)[np.searchsorted(self.boundaries, position, side="right")]
