"""A bell on a background."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import Profile, Value
from ruptfx.input.profiles.places import Center, SmoothHalfWidth


class Gaussian(Profile):
    """`background + amplitude exp(-((position - center) / width)**2 / 2)`."""

    radial: ClassVar[bool] = True
    example: ClassVar[str] = '{ kind = "gaussian", background = 1.0, amplitude = 2.0, center = 0.1, width = 0.2 }'
    background: Value
    """Value far away."""
    amplitude: Value
    """Height of the bell."""
    center: Center
    """Position of the maximum."""
    width: SmoothHalfWidth
    """Standard deviation."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.background + self.amplitude * np.exp(-0.5 * ((position - self.center) / self.width) ** 2)
