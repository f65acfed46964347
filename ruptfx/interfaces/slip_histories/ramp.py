"""Slip that grows linearly."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import VaryingTime
from ruptfx.interfaces.slip_histories._growth import Growth, ramp

SMOOTHED = 0.1


class Ramp(Growth):
    """Slip that grows linearly over the rise time, as in the model of Haskell; its ends are smoothed.

    The slip rate rises and falls linearly over `smoothing`, so that the growth takes `rise_time` + `smoothing`.
    Source: Haskell (1964).
    """

    example: ClassVar[str] = '{ kind = "ramp", slip = 1e-6, rise_time = 2e-6 }'
    source: ClassVar[str] = "Haskell (1964)"

    rise_time: VaryingTime
    """Time over which slip grows."""
    smoothing: VaryingTime | None = None
    """Time over which the slip rate begins and ends; default is a tenth of the rise time."""

    def _times(self) -> tuple[np.ndarray, np.ndarray]:
        rise = np.asarray(self.rise_time)
        return rise, SMOOTHED * rise if self.smoothing is None else np.asarray(self.smoothing)

    def grown(self, time: np.ndarray) -> np.ndarray:
        return ramp(time, *self._times())[0]

    def growth(self, time: np.ndarray) -> np.ndarray:
        return ramp(time, *self._times())[1]

    def note(self) -> str:
        return "" if self.smoothing is not None else "the slip rate begins and ends over a tenth of the rise time"
