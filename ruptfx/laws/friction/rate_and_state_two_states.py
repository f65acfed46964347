"""Rate and state friction with two state variables."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingFactor, VaryingLength
from ruptfx.laws.friction import AT_REST, Array, LawState
from ruptfx.laws.friction._memory import approach
from ruptfx.laws.friction.lengths import RateDependence
from ruptfx.laws.friction.rate_and_state_base import Creeping


class RateAndStateTwoStates(Creeping):
    """Rate and state with two state variables, each with the slip law over a length of its own.

    After a step of the slip rate friction decays by b over D_c and by b_2 over D_c_2; a negative b_2 is an
    evolution that strengthens.
    """

    state_fields = {"psi_1": "1", "psi_2": "1"}
    formula = (
        "strength = a sigma asinh(V/(2 V_0) exp((f_0 + psi_1 + psi_2)/a)); "
        "dpsi_i/dt = -(V/D_i) [psi_i + b_i ln(V/V_0)], b_1 = b, D_1 = D_c, D_2 = D_c_2"
    )
    source = "Ruina (1983), eq. 9; Tullis and Weeks (1986), Pure Appl. Geophys. 124, 383-414; regularised as the others"

    b_2: VaryingFactor
    """Evolution effect of the second state variable, of either sign."""
    D_c_2: VaryingLength
    """Slip over which the second state variable follows a change of the slip rate."""
    psi_1_initial: VaryingCoefficient | None = None
    """First state variable at the start, beside a second one of 0; without it, the second one is that of steady sliding
    at the initial slip rate, and the first one is such that the initial shear stress is carried."""

    def _steady(self, slip_rate: Array) -> dict[str, Any]:
        log_rate = np.log(np.maximum(np.abs(slip_rate), AT_REST) / self.V_0)
        return {"psi_1": -self.b * log_rate, "psi_2": -self.b_2 * log_rate}

    def psi(self, state: LawState) -> Array:
        return self.f_0 + state["psi_1"] + state["psi_2"]

    def state_of(self, psi: np.ndarray, slip_rate: np.ndarray) -> LawState:
        second = self._steady(slip_rate)["psi_2"] + 0 * psi
        return {"psi_1": psi - self.f_0 - second, "psi_2": second}

    def given_state(self, normal_stress: np.ndarray) -> LawState | None:
        if self.psi_1_initial is None:
            return None
        return {"psi_1": 0 * normal_stress + self.psi_1_initial, "psi_2": 0 * normal_stress}

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        slip, goals = np.maximum(np.abs(slip_rate), AT_REST) * dt, self._steady(slip_rate)
        lengths = {"psi_1": self.D_c, "psi_2": self.D_c_2}
        return {name: approach(state[name], goals[name], slip / length) for name, length in lengths.items()}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.strength(np.maximum(slip_rate, AT_REST), normal_stress, self._steady(slip_rate))

    def lengths(self, normal_stress: Array, slip_rate: Array) -> RateDependence:
        """Return the lengths of small perturbations; the slip is such that the critical stiffness is exact.

        At the onset, with z the square of the wave number in slip, a = sum of b_i / (1 + z D_i^2) and
        K_c = sigma z sum of b_i D_i / (1 + z D_i^2).
        """
        first, second = np.square(self.D_c), np.square(self.D_c_2)
        b = self.b + self.b_2
        quadratic, linear = self.a * first * second, self.a * (first + second) - self.b * second - self.b_2 * first
        root = np.sqrt(np.maximum(linear * linear - 4 * quadratic * (self.a - b), 0.0))
        # The positive root in the form without cancellation.
        forward = np.where(linear > 0, linear + root, 1.0)
        z = np.where(linear > 0, 2 * (b - self.a) / forward, (root - linear) / (2 * quadratic))
        stiffness = z * (self.b * self.D_c / (1 + z * first) + self.b_2 * self.D_c_2 / (1 + z * second))
        is_known = (b > self.a) & (stiffness > 0)
        slip = np.where(is_known, (b - self.a) / np.where(is_known, stiffness, 1.0), np.maximum(self.D_c, self.D_c_2))
        return RateDependence(self.a * normal_stress, b * normal_stress, slip)
