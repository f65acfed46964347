"""Rate and state friction whose direct effect, ageing and time scale depend on temperature."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import VaryingFactor, VaryingRatio, VaryingTemperature
from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction.lengths import RateDependence
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.friction.rate_and_state_base import RateAndState

LEAST = 1e-3
"""Smallest factor of a and b, which no extrapolation to a temperature makes zero or negative."""
LARGEST_SHIFT = 30.0
"""Largest decimal logarithm of the shift factor, either way."""


class RateAndStateThermal(RateAndState):
    """Rate and state, ageing law, with temperature: a(T) and b(T), and ages that grow faster by 1 / a_T.

    Static friction at a contact time and a temperature is that at the time over a_T, the equivalence of time and
    temperature of Williams, Landel and Ferry. The law reads the temperature of its interface; without
    `[faults.NAME.temperature]` it is `temperature_initial`.
    """

    state_fields = {"theta": "s", "temperature": "K"}
    formula = (
        "as rate_and_state_ageing with a [1 + a_slope (T/T_0 - 1)], b [1 + b_slope (T/T_0 - 1)] and "
        "dtheta/dt = 1/a_T - V theta/D_c, log10 a_T = -C_1 (T - T_0)/(C_2 + T - T_0)"
    )
    source = "Baumberger, Berthoud, Caroli (2001), eqs. 4, 6, 7; Williams, Landel, Ferry (1955)"
    example: ClassVar[str] = (
        '{ kind = "rate_and_state_thermal", a = 0.013, b = 0.026, D_c = 5e-5, f_0 = 0.36, V_0 = 1e-6, '
        "T_0 = 293.0, temperature_initial = 310.0, a_slope = 1.0, b_slope = 2.0, C_1 = 8.0, C_2 = 100.0 }"
    )

    T_0: VaryingTemperature
    """Reference temperature, at which a and b are given and a_T is 1."""
    temperature_initial: VaryingTemperature
    """Temperature of an interface without a table of it."""
    a_slope: VaryingFactor = 0.0
    """Relative change of a with the relative change of the temperature; 1 for thermal activation with a constant
    volume."""
    b_slope: VaryingFactor = 0.0
    """Relative change of b with the relative change of the temperature."""
    C_1: VaryingRatio = 0.0
    """Constant of the shift factor; 0 shifts no times."""
    C_2: VaryingTemperature = 50.0
    """Constant of the shift factor: below T_0 - C_2 nothing ages."""

    def _factor(self, slope: Array, temperature: Array) -> Array:
        return np.maximum(1 + slope * (temperature / self.T_0 - 1), LEAST)

    def shift(self, temperature: Array) -> Array:
        """Return the factor a_T of times [1] at a temperature [K], point by point."""
        above = temperature - self.T_0
        room = np.maximum(self.C_2 + above, 1e-3 * self.C_2)
        exponent = np.minimum(np.maximum(-self.C_1 * above / room, -LARGEST_SHIFT), LARGEST_SHIFT)
        return np.exp(np.log(10.0) * exponent)

    def at_temperature(self, temperature: Array) -> RateAndStateAgeing:
        """Return the ageing law with a and b of a temperature; its age is the state of this law."""
        return RateAndStateAgeing.model_construct(
            a=self.a * self._factor(self.a_slope, temperature), b=self.b * self._factor(self.b_slope, temperature),
            D_c=self.D_c, f_0=self.f_0, V_0=self.V_0, V_initial=self.V_initial, theta_initial=self.theta_initial,
        )  # fmt: skip

    def isothermal(self) -> RateAndStateAgeing:
        """Return the ageing law of the same strength at `temperature_initial`; its age is the contact time."""
        law = self.at_temperature(self.temperature_initial)
        return law.substituted({"f_0": law.f_0 - law.b * np.log(self.shift(self.temperature_initial))})

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        law = self.at_temperature(self.temperature_initial)
        state = law.initial_state(normal_stress, shear_stress, slip_rate)
        return {**state, "temperature": 0 * normal_stress + self.temperature_initial}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        law = self.at_temperature(state["temperature"])
        return law.strength(slip_rate, normal_stress, {"theta": state["theta"]})

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        law, shift = self.at_temperature(state["temperature"]), self.shift(state["temperature"])
        aged = law.advance({"theta": state["theta"] * shift}, slip_rate, normal_stress, dt)
        return {"theta": aged["theta"] / shift, "temperature": state["temperature"] + 0 * dt}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        law = self.at_temperature(state["temperature"])
        return law.carried_slip_rate(shear_stress, normal_stress, {"theta": state["theta"]})

    def lengths(self, normal_stress: Array, slip_rate: Array) -> RateDependence:
        return self.isothermal().lengths(normal_stress, slip_rate)

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        return 1 / self.shift(self.temperature_initial) - np.abs(slip_rate) * theta / self.D_c

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.isothermal().steady_strength(slip_rate, normal_stress)
