"""Slip of a dynamic crack as a function of time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import VaryingTime
from ruptfx.interfaces.slip_histories._growth import Growth

SMOOTHED = 0.1


class Yoffe(Growth):
    """Regularised Yoffe function: a sharp peak of the slip rate, and a slow decay, as behind the front of a crack.

    The Yoffe function 2 / (pi tau) sqrt((tau - t) / t), tau = `rise_time`, averaged with a triangle of the
    half-duration `smoothing`; slip grows over tau + 2 `smoothing`. Its double integrals give the mean exactly.
    Source: Tinti et al. (2005).
    """

    example: ClassVar[str] = '{ kind = "yoffe", slip = 1e-6, rise_time = 2e-6, smoothing = 3e-7 }'
    source: ClassVar[str] = "Tinti et al. (2005)"

    rise_time: VaryingTime
    """Duration of the Yoffe function."""
    smoothing: VaryingTime | None = None
    """Half-duration of the triangle, about the time from the onset to the peak; default is a tenth of the rise time."""

    def _averaged(self, time: np.ndarray, integral: int) -> np.ndarray:
        rise = np.asarray(self.rise_time)
        half = (SMOOTHED if self.smoothing is None else np.asarray(self.smoothing) / rise) + 0 * rise
        x = np.clip(time / rise, 0.0, 1 + 2 * half)
        first, middle, last = (integrals(x - shift * half)[integral] for shift in range(3))
        mean = (first - 2 * middle + last) / half**2
        return np.where(time / rise < 1 + 2 * half, mean, 1.0 if integral == 2 else 0.0)

    def grown(self, time: np.ndarray) -> np.ndarray:
        return self._averaged(time, 2)

    def growth(self, time: np.ndarray) -> np.ndarray:
        return self._averaged(time, 1) / np.asarray(self.rise_time)

    def note(self) -> str:
        return "" if self.smoothing is not None else "smoothed with a triangle of a tenth of the rise time"


def integrals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the slip of the Yoffe function at times x over its duration, and its first and second integral over x.

    With x = sin^2 a the slip is S = (2 a + sin 2a) / pi; its integrals are those of powers of sines.
    """
    inside = np.clip(x, 0.0, 1.0)
    a = np.arcsin(np.sqrt(inside))
    two = np.sin(2 * a)
    slip = (2 * a + two) / np.pi
    first = inside * slip - (a / 2 - np.sin(4 * a) / 8) / np.pi
    square = (a / 2 - np.sin(4 * a) / 8 - two**3 / 6) / 4
    line = -a * np.cos(2 * a) / 8 + two / 16 - two**3 / 48
    second = inside**2 * slip / 2 - (square + 2 * line) / np.pi
    beyond = np.maximum(x - 1, 0.0)
    # At x = 1 the first integral is 3/4, the area under S, and the second 5/16.
    return slip, first + beyond, second + 0.75 * beyond + 0.5 * beyond**2
