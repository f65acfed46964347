"""Rate and state friction with strong rate weakening (flash heating), slip law."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import Array, FrictionLaw, LawState
from ruptfx.friction._rate_and_state import log_sinh
from ruptfx.units import VaryingCoefficient, VaryingExponent, VaryingLength, VaryingSpeed

_AT_REST = 1e-100  # m/s, far below any slip rate; the state does not change there
_LOWEST = 1e-6  # friction coefficient; the logarithm of the low-velocity law would pass zero at absurd slip rates


class RateAndStateFlashHeating(FrictionLaw):
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

    a: VaryingExponent
    b: VaryingExponent
    D_c: VaryingLength
    f_0: VaryingCoefficient
    V_0: VaryingSpeed
    f_w: VaryingCoefficient
    V_w: VaryingSpeed
    V_initial: VaryingSpeed = 1e-9
    """Slip rate [m/s] at which the initial shear stress is carried, where the interface is given at rest."""
    psi_initial: VaryingCoefficient | None = None
    """Initial state; without it, the state that carries the initial shear stress at the initial slip rate."""

    def steady_coefficient(self, slip_rate: Array) -> Array:
        """f_ss(V)."""
        speed = np.maximum(slip_rate, _AT_REST)
        low = np.maximum(self.f_0 - (self.b - self.a) * np.log(speed / self.V_0), _LOWEST)
        # [1 + x^8]^(-1/8) with the larger of x and 1 taken out, so that nothing overflows.
        x = speed / self.V_w
        large, small = np.maximum(x, 1.0), np.minimum(x, 1.0)
        bend = 1 / (large * ((1 / large) ** 8 + small**8) ** 0.125)
        return np.maximum(self.f_w + (low - self.f_w) * bend, _LOWEST)

    def steady_psi(self, slip_rate: Array) -> Array:
        """psi_ss(V) = a [ln(2 sinh(f_ss / a)) - ln(V / V_0)]."""
        speed = np.maximum(slip_rate, _AT_REST)
        return self.a * (log_sinh(self.steady_coefficient(slip_rate) / self.a) - np.log(speed / self.V_0))

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        if self.psi_initial is not None:
            return {"psi": np.zeros_like(normal_stress) + self.psi_initial}
        speed = np.where(np.abs(slip_rate) > 0, np.abs(slip_rate), self.V_initial)
        # An unloaded or open point has no state that fits: its stress counts as 1e-6 of the normal stress.
        pressure = np.where(normal_stress > 0, normal_stress, 1.0)
        ratio = np.maximum(np.abs(shear_stress) / pressure, _LOWEST)
        return {"psi": self.a * (log_sinh(ratio / self.a) - np.log(speed / self.V_0))}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        argument = slip_rate / (2 * self.V_0) * np.exp(np.minimum(state["psi"] / self.a, 700.0))
        return self.a * normal_stress * np.arcsinh(argument)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate.
        forgotten = -np.expm1(-slip_rate * dt / self.D_c)
        return {"psi": state["psi"] + (self.steady_psi(slip_rate) - state["psi"]) * forgotten}

    def given_slip_rate(self) -> Array | None:
        return self.V_initial if self.psi_initial is not None and "V_initial" in self.model_fields_set else None

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        drive = np.abs(shear_stress) / (self.a * np.maximum(normal_stress, 1e-300))
        return self.V_0 * (np.exp(drive - state["psi"] / self.a) - np.exp(-drive - state["psi"] / self.a))

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.steady_coefficient(slip_rate) * normal_stress
