"""Quadratic in the distance from a point."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import PositiveMetre, Profile, Value
from ruptfx.input.profiles.places import Center


class Parabola(Profile):
    """`tip + (position - center)^2 / (2 radius)`: as a gap, a cylinder of that radius on a plane."""

    radial: ClassVar[bool] = True
    example: ClassVar[str] = '{ kind = "parabola", radius = 2.0, center = 0.1, tip = 0.01 }'
    radius: PositiveMetre
    """Radius of curvature at the tip."""
    center: Center
    """Position of the tip."""
    tip: Value = 0.0
    """Value at the center."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.tip + (position - self.center) ** 2 / (2 * self.radius)
