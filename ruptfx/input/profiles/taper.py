"""One value within a patch, a smooth step to another."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import PositiveMetre, Profile, Value
from ruptfx.input.profiles.places import Center, SmoothHalfWidth


class Taper(Profile):
    """`inside` within half_width, then a smooth step over `width` to `outside`.

    The step is B = (1 + tanh(w/(d - W - w) + w/(d - W))) / 2 for W < d < W + w, with d = |position - center|
    (Source: SCEC/USGS benchmark TPV101 description).
    """

    radial: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "taper", inside = 2.0, outside = 1.0, center = 0.0, half_width = 0.3, width = 0.2 }'
    )
    inside: Value
    """Value within half_width."""
    outside: Value
    """Value beyond half_width + width."""
    center: Center
    """Middle of the profile."""
    half_width: SmoothHalfWidth
    """Distance at which the step begins."""
    width: PositiveMetre
    """Length of the step."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        distance = np.abs(position - self.center)
        step = np.where(distance <= self.half_width, 1.0, 0.0)
        ramp = (distance > self.half_width) & (distance < self.half_width + self.width)
        over = distance[ramp] - self.half_width
        step[ramp] = 0.5 * (1 + np.tanh(self.width / (over - self.width) + self.width / over))
        return self.outside + (self.inside - self.outside) * step
