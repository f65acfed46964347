"""Linear in the distance from a point."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import Profile, Value
from ruptfx.input.profiles.places import Center


class Cone(Profile):
    """`tip + slope |position - center|`, at most `limit`; with slope = 1 / v the arrival time of a rupture."""

    radial: ClassVar[bool] = True
    example: ClassVar[str] = '{ kind = "cone", slope = 0.5, center = 0.0, tip = 0.1, limit = 0.4 }'
    slope: float
    """Change per distance."""
    center: Center
    """Position of the tip."""
    tip: Value = 0.0
    """Value at the center."""
    limit: Value | None = None
    """Largest value."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        values = self.tip + self.slope * np.abs(position - self.center)
        return values if self.limit is None else np.minimum(values, self.limit)
