"""One value within a rectangle of a surface, another beyond it."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.profiles import Profile, Value
from ruptfx.profiles._rim import Range, sharp, smooth
from ruptfx.schema import Unit


class Rectangle(Profile):
    """`inside` in a rectangle of a surface, `outside` beyond it; nodes on a sharp edge carry the mean of both sides."""

    over_surface: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "rectangle", inside = 2.0, outside = 1.0, strike = [-0.4, 0.3], dip = [0.0, 0.5], rim = 0.1 }'
    )
    inside: Value
    """Value in the rectangle."""
    outside: Value
    """Value beyond it."""
    strike: Range
    """Both ends along the first position (strike)."""
    dip: Range
    """Both ends along the second position: down dip, from the upper edge of the surface."""
    rim: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Width of a smooth transition outside of the rectangle; 0: a sharp edge."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        share = np.ones(len(position))
        for values, (first, last) in zip(position.T, (self.strike, self.dip), strict=True):
            distance, half = np.abs(values - 0.5 * (first + last)), 0.5 * (last - first)
            share = share * (smooth(distance, half, self.rim) if self.rim else sharp(distance, half))
        return self.outside + (self.inside - self.outside) * share
