"""Heat of friction that is conducted into both bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.units import HeatCapacity, VaryingDiffusivity, Width
from ruptfx.interfaces.faults.across import Across
from ruptfx.interfaces.faults.fields import Contribution, Heating
from ruptfx.interfaces.temperature import Temperature

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System


class Conduction(Temperature):
    """Rise of the temperature by friction: all its power heats a layer or a plane, and is conducted along the normal.

    dT/dt = alpha_th d2T/dy2 + tau V g(y) / (rho c), g a Gaussian of standard deviation w, or a plane with w = 0.
    """

    source = "Carslaw and Jaeger (1959); in wavenumbers Noda and Lapusta (2010)"
    example: ClassVar[str] = '{ kind = "conduction", heat_capacity = 2.7e6, thermal_diffusivity = 1e-6 }'

    heat_capacity: HeatCapacity
    """rho c, density times heat capacity, per volume."""
    thermal_diffusivity: VaryingDiffusivity
    """alpha_th of heat."""
    width: Width = 0.0
    """w of the heated layer; 0: a plane."""

    def bind(self, model: System, face: Interface, key: str) -> HeatedLayer:
        return HeatedLayer(self, model.case.duration, len(face.plus))


class HeatedLayer(Contribution):
    """Amplitudes of the temperature across the interface."""

    adds = ("temperature",)
    is_heated = True

    def __init__(self, table: Conduction, duration: float, points: int) -> None:
        self._capacity, self._points = table.heat_capacity, points
        self._across = Across(np.broadcast_to(table.thermal_diffusivity, max(points, 1)), table.width, duration)

    def memory(self) -> dict[str, np.ndarray]:
        return {"temperature": np.zeros((self._points, self._across.count))}

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        rise = self._across.value(memory["temperature"], heating.elapsed, heating.heat, heating.growth)
        return {"temperature": rise / self._capacity}

    def advance(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> None:
        self._across.advance(memory["temperature"], heating.elapsed, heating.heat, heating.growth)
