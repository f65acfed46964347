"""Slip whose rate is a Gaussian in time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import VaryingTime
from ruptfx.interfaces.slip_histories._growth import Growth

REACH = 5.0
"""Widths from the onset to the peak, at which the rate is 4e-6 of its peak."""


class Gaussian(Growth):
    """Slip whose rate is a Gaussian in time; its peak is five widths after the onset, and its end as far behind."""

    example: ClassVar[str] = '{ kind = "gaussian", slip = 1e-6, width = 3e-7 }'

    width: VaryingTime
    """Standard deviation of the Gaussian."""

    def grown(self, time: np.ndarray) -> np.ndarray:
        from scipy.special import ndtr

        tail = ndtr(-REACH)
        return np.asarray((ndtr(np.clip(time / self.width - REACH, -REACH, REACH)) - tail) / (1 - 2 * tail))

    def growth(self, time: np.ndarray) -> np.ndarray:
        away = time / self.width - REACH
        return np.where(np.abs(away) < REACH, self._density(away), 0.0)

    def _density(self, away: np.ndarray | float) -> np.ndarray:
        from scipy.special import ndtr

        return np.asarray(np.exp(-0.5 * np.square(away)) / (np.sqrt(2 * np.pi) * self.width * (1 - 2 * ndtr(-REACH))))

    def sudden(self) -> np.ndarray:
        return self._density(REACH)
