"""Prakash-Clifton memory of the normal stress, around any law."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.units import VaryingLength, VaryingRatio, VaryingVelocity


class PrakashClifton(FrictionLaw):
    """Normal-stress memory: the held law sees theta_p, which follows D sigma over the slip L_p, not sigma itself.

    The default regularisation between different materials, where plain Coulomb friction has no solution: slip on a
    length that the mesh can resolve, whatever the slip rate.
    """

    state_fields = {"theta_p": "Pa"}
    formula = "strength = law(V, theta_p); dtheta_p/dt = -(theta_p - D sigma) (V + V_star) / L_p"
    source = "Prakash and Clifton (1993); Prakash (1998); with V_star: Cochard and Rice (2000)"

    law: AnyFriction
    L_p: VaryingLength
    D: VaryingRatio = 1.0
    theta_p_ratio: VaryingRatio = 1.0
    """Initial theta_p / (D sigma); below 1 the interface starts weak and strengthens as it slips."""
    V_star: VaryingVelocity = 0.0
    """Added to the slip rate: the memory fades also at rest, within L_p / V_star."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        theta_p = self.theta_p_ratio * self.D * normal_stress
        return {**self.law.initial_state(theta_p, shear_stress, slip_rate), "theta_p": theta_p}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        # An open interface carries nothing, whatever it remembers.
        remembered = np.where(normal_stress > 0, state["theta_p"], 0.0)
        return self.law.strength(slip_rate, remembered, state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate and normal stress.
        forgotten = -np.expm1(-(slip_rate + self.V_star) * dt / self.L_p)
        theta_p = state["theta_p"] + (self.D * normal_stress - state["theta_p"]) * forgotten
        return {**self.law.advance(state, slip_rate, theta_p, dt), "theta_p": theta_p}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, state["theta_p"], state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.law.steady_strength(slip_rate, self.D * normal_stress)
