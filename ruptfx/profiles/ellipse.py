"""One value within an ellipse of a surface, another beyond it."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.profiles import Profile, Value
from ruptfx.profiles._rim import Range, sharp, smooth
from ruptfx.schema import Unit


class Ellipse(Profile):
    """`inside` in an ellipse of a surface, `outside` beyond it."""

    over_surface: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "ellipse", inside = 2.0, outside = 1.0, strike = [-0.4, 0.6], dip = [0.1, 0.5], rim = 0.05 }'
    )
    inside: Value
    """Value in the ellipse."""
    outside: Value
    """Value beyond it."""
    strike: Range
    """Both ends of its axis along the first position (strike)."""
    dip: Range
    """Both ends of its axis along the second position: down dip, from the upper edge of the surface."""
    rim: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Width of a smooth transition outside of the ellipse, along the mean half-axis; 0: a sharp edge."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        ends = np.array([self.strike, self.dip])
        half = 0.5 * (ends[:, 1] - ends[:, 0])
        radius = np.linalg.norm((position - ends.mean(axis=1)) / half, axis=1)
        mean = float(np.mean(half))
        share = smooth(mean * radius, mean, self.rim) if self.rim else sharp(radius, 1.0)
        return self.outside + (self.inside - self.outside) * share
