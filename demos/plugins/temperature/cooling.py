"""A temperature that falls exponentially."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ruptfx.plugin import Contribution, Duration, Heating, Temperature, VaryingTemperature


class Cooling(Temperature):
    """A temperature that falls exponentially."""

    example = '{ kind = "cooling", start = 400.0, time = 1e-3 }'

    start: VaryingTemperature
    """Temperature at the start."""
    time: Duration
    """Time in which it falls to 1 / e."""

    def bind(self, model: Any, face: Any, key: str) -> Contribution:
        return Cooled(np.broadcast_to(self.start, len(face.plus)), self.time)


class Cooled(Contribution):
    """The temperature at the points."""

    adds = ("temperature",)

    def __init__(self, start: np.ndarray, duration: float) -> None:
        self._start, self._duration = start, duration

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        return {"temperature": self._start * np.exp(-(time + heating.elapsed) / self._duration)}
