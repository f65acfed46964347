"""A cosine."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from ruptfx.input.profiles import PositiveMetre, Profile, Value
from ruptfx.input.schema import Unit


class Sinusoid(Profile):
    """`mean + amplitude cos(2 pi position / wavelength + phase)`."""

    example: ClassVar[str] = '{ kind = "sinusoid", mean = 1.0, amplitude = 0.5, wavelength = 0.8, phase = 0.3 }'
    amplitude: Value
    """Of the cosine."""
    wavelength: PositiveMetre
    """Of the cosine."""
    mean: Value = 0.0
    """Mean value."""
    phase: Annotated[float, Unit("rad")] = 0.0
    """Phase of the cosine at position 0."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.mean + self.amplitude * np.cos(2 * np.pi * position / self.wavelength + self.phase)
