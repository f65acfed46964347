"""Rate and state friction with strong rate weakening (flash heating), slip law."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingSpeed
from ruptfx.laws.friction import AT_REST, Array, LawState
from ruptfx.laws.friction.rate_and_state_base import LOWEST, Creeping, log_sinh


class RateAndStateFlashHeating(Creeping):
    """Rate and state with strong rate weakening: above V_w steady friction falls towards f_w, as with flash heating.

    The state psi follows the slip law towards the value that makes the strength at steady sliding f_ss sigma.
    """

    state_fields = {"psi": "1"}
    formula = (
        "strength = a sigma asinh(V/(2 V_0) exp(psi/a)); dpsi/dt = -(V/D_c) (psi - psi_ss), "
        "psi_ss = a ln[(2 V_0/V) sinh(f_ss/a)], f_ss = f_w + (f_LV - f_w) / [1 + (V/V_w)^8]^(1/8), "
        "f_LV = f_0 - (b - a) ln(V/V_0)"
    )
    source = "Dunham, Belanger, Cong, Kozdon (2011); flash heating: Rice (2006); SCEC/USGS benchmark TPV103"

    f_w: VaryingCoefficient
    """Fully weakened coefficient."""
    V_w: VaryingSpeed
    """Slip rate above which friction weakens strongly."""
    psi_initial: VaryingCoefficient | None = None
    """Initial state; without it, the state that carries the initial shear stress at the initial slip rate."""

    def steady_coefficient(self, slip_rate: Array) -> Array:
        """Return the friction coefficient f_ss [1] of steady sliding at a slip rate [m/s], point by point."""
        speed = np.maximum(slip_rate, AT_REST)
        # The logarithm of the low-velocity law becomes negative only at unrealistic slip rates.
        low = np.maximum(self.f_0 - (self.b - self.a) * np.log(speed / self.V_0), LOWEST)
        # [1 + x^8]^(-1/8) with the larger of x and 1 taken out, so that nothing overflows.
        x = speed / self.V_w
        large, small = np.maximum(x, 1.0), np.minimum(x, 1.0)
        bend = 1 / (large * ((1 / large) ** 8 + small**8) ** 0.125)
        return np.maximum(self.f_w + (low - self.f_w) * bend, LOWEST)

    def steady_psi(self, slip_rate: Array) -> Array:
        """Return psi_ss(V) = a [ln(2 sinh(f_ss / a)) - ln(V / V_0)]."""
        speed = np.maximum(slip_rate, AT_REST)
        return self.a * (log_sinh(self.steady_coefficient(slip_rate) / self.a) - np.log(speed / self.V_0))

    def psi(self, state: LawState) -> Array:
        return state["psi"]

    def state_of(self, psi: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"psi": psi}

    def given_state(self, normal_stress: np.ndarray) -> LawState | None:
        return None if self.psi_initial is None else {"psi": 0 * normal_stress + self.psi_initial}

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate.
        forgotten = -np.expm1(-slip_rate * dt / self.D_c)
        return {"psi": state["psi"] + (self.steady_psi(slip_rate) - state["psi"]) * forgotten}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.steady_coefficient(slip_rate) * normal_stress
