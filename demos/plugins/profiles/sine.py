"""A sine from the origin."""

from typing import ClassVar

import numpy as np

from ruptfx.plugin import PositiveMetre, Profile, Value


class Sine(Profile):
    """A sine from the origin."""

    example: ClassVar[str] = '{ kind = "sine", mean = 2e6, amplitude = 1e6, wavelength = 1e-2 }'
    mean: Value
    """Mean of the values."""
    amplitude: Value
    """Largest deviation from the mean."""
    wavelength: PositiveMetre
    """Length of a period."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.mean + self.amplitude * np.sin(2 * np.pi * position / self.wavelength)
