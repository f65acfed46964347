"""Exponential velocity weakening."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingSpeed
from ruptfx.laws.friction import Array, FrictionLaw, LawState


class VelocityWeakening(FrictionLaw):
    """Velocity weakening: the coefficient falls exponentially from mu_s at rest to mu_d at speed, without memory."""

    formula = "strength = [mu_d + (mu_s - mu_d) exp(-V / V_w)] sigma"
    source = "Kammer, Yastrebov, Spijker, Molinari (2012), with V_w = sqrt(omega / (mu_s - mu_d)) of the thesis form"

    mu_s: VaryingCoefficient
    """Coefficient at rest."""
    mu_d: VaryingCoefficient
    """Coefficient at high slip rates."""
    V_w: VaryingSpeed
    """Slip rate over which it falls by 1/e."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return (self.mu_d + (self.mu_s - self.mu_d) * np.exp(-slip_rate / self.V_w)) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.strength(slip_rate, normal_stress, {})
