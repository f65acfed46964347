"""Linear slip weakening."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import Array, FrictionLaw, LawState
from ruptfx.units import VaryingCoefficient, VaryingLength


class LinearSlipWeakening(FrictionLaw):
    """Linear slip weakening: the coefficient falls from mu_s to mu_d over the slip D_c and stays there."""

    state_fields = {"cumulative_slip": "m"}
    formula = "strength = [mu_s - (mu_s - mu_d) min(cumulative_slip / D_c, 1)] sigma"
    source = "Ida (1972); Andrews (1976)"

    mu_s: VaryingCoefficient
    mu_d: VaryingCoefficient
    D_c: VaryingLength

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"cumulative_slip": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        weakened = np.minimum(state["cumulative_slip"] / self.D_c, 1.0)
        return (self.mu_s - (self.mu_s - self.mu_d) * weakened) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {"cumulative_slip": state["cumulative_slip"] + slip_rate * dt}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.mu_d * normal_stress
