"""One value within a box, another beyond it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import Profile, Value
from ruptfx.input.profiles.places import Center, HalfWidth


class Boxcar(Profile):
    """`inside` for |position - center| <= half_width, `outside` elsewhere."""

    radial: ClassVar[bool] = True
    example: ClassVar[str] = '{ kind = "boxcar", inside = 2.0, outside = 1.0, center = 0.1, half_width = 0.2 }'
    inside: Value
    """Value in the box."""
    outside: Value
    """Value beyond it."""
    center: Center
    """Middle of the box."""
    half_width: HalfWidth
    """Half the length of the box."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        # A node on the edge belongs to the box, whatever the rounding of its coordinate.
        near = np.abs(position - self.center) <= self.half_width * (1 + 1e-9)
        return np.where(near, self.inside, self.outside)
