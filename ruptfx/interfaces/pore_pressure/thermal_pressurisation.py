"""Thermal pressurisation: friction heats the pore fluid, which expands and diffuses into both bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.units import HeatCapacity, PressurePerTemperature, VaryingDiffusivity, Width
from ruptfx.interfaces.faults.across import Across
from ruptfx.interfaces.faults.fields import Contribution, Heating
from ruptfx.interfaces.field_table import MOTION
from ruptfx.interfaces.pore_pressure import PorePressure

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System

APART = 1e-4
"""Least relative difference of the diffusivities in the formula of two diffusions; equal ones are moved apart by it,
which changes the pressure by its square."""


class ThermalPressurisation(PorePressure):
    """Thermal pressurisation: pressure and temperature of a heated layer or plane, with diffusion along the normal.

    dT/dt = alpha_th d2T/dy2 + tau V g(y) / (rho c),   dp/dt = alpha_hy d2p/dy2 + Lambda dT/dt, with a Gaussian g of
    standard deviation w, or a plane with w = 0. Both are the changes since the start of the run.
    """

    needs = frozenset({MOTION})
    source = "Sibson (1973); Lachenbruch (1980); Rice (2006); Noda and Lapusta (2010)"
    example: ClassVar[str] = (
        '{ kind = "thermal_pressurisation", heat_capacity = 2.7e6, thermal_diffusivity = 1e-6, '
        "hydraulic_diffusivity = 4e-4, pressure_per_temperature = 0.1e6, width = 20e-3 }"
    )

    heat_capacity: HeatCapacity
    """rho c, density times heat capacity, per volume."""
    thermal_diffusivity: VaryingDiffusivity
    """alpha_th of heat."""
    hydraulic_diffusivity: VaryingDiffusivity
    """alpha_hy of the fluid."""
    pressure_per_temperature: PressurePerTemperature
    """Lambda: undrained change of the pore pressure with the temperature."""
    width: Width
    """w of the heated layer; 0: a plane."""

    def bind(self, model: System, face: Interface, key: str) -> PressurisedLayer:
        return PressurisedLayer(self, model.case.duration, len(face.plus))


class PressurisedLayer(Contribution):
    """Amplitudes of two diffusions, by which pressure and temperature follow.

    With D the temperature for a unit of heat capacity and a diffusivity (`Across`),
    p = Lambda / (rho c) [alpha_hy D(alpha_hy) - alpha_th D(alpha_th)] / (alpha_hy - alpha_th)  (Rice 2006).
    """

    adds = ("pore_pressure", "temperature")
    is_heated = True

    def __init__(self, table: ThermalPressurisation, duration: float, points: int) -> None:
        self._points, self._capacity = points, table.heat_capacity
        n = max(points, 1)
        heat, water = (np.broadcast_to(each, n).astype(float) for each in (
            table.thermal_diffusivity, table.hydraulic_diffusivity))  # fmt: skip
        close = np.abs(water - heat) < APART * heat
        heat, water = np.where(close, heat * (1 - APART / 2), heat), np.where(close, heat * (1 + APART / 2), water)
        self._across = {
            "heat": Across(heat, table.width, duration), "water": Across(water, table.width, duration),
        }  # fmt: skip
        scale = table.pressure_per_temperature / table.heat_capacity / (water - heat)
        self._factors = {"heat": (-scale * heat)[:points], "water": (scale * water)[:points]}

    def memory(self) -> dict[str, np.ndarray]:
        return {name: np.zeros((self._points, across.count)) for name, across in self._across.items()}

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        values = {
            name: across.value(memory[name], heating.elapsed, heating.heat, heating.growth)
            for name, across in self._across.items()
        }
        pressure = sum(self._factors[name] * each for name, each in values.items())
        return {"pore_pressure": np.asarray(pressure), "temperature": values["heat"] / self._capacity}

    def advance(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> None:
        for name, across in self._across.items():
            across.advance(memory[name], heating.elapsed, heating.heat, heating.growth)

    def uncertainty(self, heating: Heating) -> np.ndarray:
        return np.asarray(self._factors["water"] * self._across["water"].uncertainty(heating.elapsed, heating.growth))
