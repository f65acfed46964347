"""Exponential slip weakening."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import Array, FrictionLaw, LawState
from ruptfx.units import VaryingCoefficient, VaryingLength


class ExponentialSlipWeakening(FrictionLaw):
    """Exponential slip weakening: the coefficient falls from mu_s to mu_d, by a factor e of the rest per slip D_c.

    The fracture energy is (mu_s - mu_d) sigma D_c, twice that of the linear law with the same D_c.
    """

    state_fields = {"cumulative_slip": "m"}
    formula = "strength = [mu_d + (mu_s - mu_d) exp(-cumulative_slip / D_c)] sigma"
    source = "exponential member of the slip-dependent laws of Ida (1972)"

    mu_s: VaryingCoefficient
    mu_d: VaryingCoefficient
    D_c: VaryingLength

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"cumulative_slip": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return (self.mu_d + (self.mu_s - self.mu_d) * np.exp(-state["cumulative_slip"] / self.D_c)) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {"cumulative_slip": state["cumulative_slip"] + slip_rate * dt}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.mu_d * normal_stress
