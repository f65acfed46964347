"""Exponential velocity weakening that evolves over a slip distance."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingLength, VaryingSpeed, VaryingVelocity
from ruptfx.laws.friction import Array, FrictionLaw, LawState
from ruptfx.laws.friction._memory import approach
from ruptfx.laws.friction.lengths import Breakdown


class VelocityWeakeningOverSlip(FrictionLaw):
    """Velocity weakening with a length: the coefficient follows that of `velocity_weakening` over the slip L.

    Velocity weakening alone is ill-posed where its slope exceeds the impedance of the bodies: fronts are then as long
    as the elements are. Here fronts have a finite length and fracture energy. At rest strength recovers within L /
    V_star.
    """

    state_fields = {"weakness": "1"}
    formula = (
        "strength = [mu_s - (mu_s - mu_d) w] sigma; dw/dt = -(w - w_ss) (V + V_star) / L, w_ss = 1 - exp(-V / V_w)"
    )
    source = "steady law: Kammer, Yastrebov, Spijker, Molinari (2012); relaxation as of Cochard and Rice (2000)"

    mu_s: VaryingCoefficient
    """Coefficient at rest."""
    mu_d: VaryingCoefficient
    """Coefficient after much slip at high slip rates."""
    V_w: VaryingSpeed
    """Slip rate over which the steady coefficient falls by 1/e."""
    L: VaryingLength
    """Slip over which the coefficient follows the steady one."""
    V_star: VaryingVelocity = 0.0
    """Added to the slip rate, so that strength also recovers at rest, within L / V_star."""

    def steady_weakness(self, slip_rate: Array) -> Array:
        return -np.expm1(-slip_rate / self.V_w)

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"weakness": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return (self.mu_s - (self.mu_s - self.mu_d) * state["weakness"]) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        times = (slip_rate + self.V_star) * dt / self.L
        return {"weakness": approach(state["weakness"], self.steady_weakness(slip_rate), times)}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.strength(slip_rate, normal_stress, {"weakness": self.steady_weakness(slip_rate)})

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown:
        """Return the breakdown at a constant slip rate."""
        peak, residual = self.mu_s * normal_stress, self.steady_strength(slip_rate, normal_stress)
        return Breakdown(peak, residual, (peak - residual) * self.L * slip_rate / (slip_rate + self.V_star))
