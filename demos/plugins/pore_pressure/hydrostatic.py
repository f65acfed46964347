"""Pressure of standing water above the interface."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ruptfx.plugin import Contribution, Coordinate, Density, Heating, PorePressure


class Hydrostatic(PorePressure):
    """Pressure of standing water above the interface."""

    example = '{ kind = "hydrostatic", level = 10.0 }'

    level: Coordinate
    """y of the water table [m]; there is no water above it."""
    density: Density = 1000.0
    """Density of the water."""

    def bind(self, model: Any, face: Any, key: str) -> Contribution:
        return StandingWater(9.81 * self.density * np.maximum(self.level - face.points[:, 1], 0.0))


class StandingWater(Contribution):
    """The pressure at the points."""

    adds = ("pore_pressure",)

    def __init__(self, pressure: np.ndarray) -> None:
        self._pressure = pressure

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        return {"pore_pressure": self._pressure.copy()}
