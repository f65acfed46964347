"""Prakash-Clifton memory of the normal stress with two variables, around any law."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.units import VaryingLength, VaryingRatio


class PrakashCliftonTwo(FrictionLaw):
    """Two-stage memory of the normal stress: the held law sees theta_1 + theta_2, each with its own length and share.

    theta_1 approaches C sigma over the slip L_1 and theta_2 approaches D sigma over L_2: a step of normal stress is
    felt partly soon and partly late.
    """

    state_fields = {"theta_1": "Pa", "theta_2": "Pa"}
    formula = (
        "strength = law(V, theta_1 + theta_2); dtheta_1/dt = -(theta_1 - C sigma) V / L_1, "
        "dtheta_2/dt = -(theta_2 - D sigma) V / L_2"
    )
    source = "Prakash (1998); Coker, Lykotrafitis, Needleman, Rosakis (2005)"

    law: AnyFriction
    L_1: VaryingLength
    L_2: VaryingLength
    C: VaryingRatio = 0.5
    D: VaryingRatio = 0.5
    theta_1_ratio: VaryingRatio = 1.0
    """Initial theta_1 / (C sigma)."""
    theta_2_ratio: VaryingRatio = 1.0
    """Initial theta_2 / (D sigma)."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        theta_1 = self.theta_1_ratio * self.C * normal_stress
        theta_2 = self.theta_2_ratio * self.D * normal_stress
        inner = self.law.initial_state(theta_1 + theta_2, shear_stress, slip_rate)
        return {**inner, "theta_1": theta_1, "theta_2": theta_2}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        # An open interface carries nothing, whatever it remembers.
        remembered = np.where(normal_stress > 0, state["theta_1"] + state["theta_2"], 0.0)
        return self.law.strength(slip_rate, remembered, state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate and normal stress.
        first = -np.expm1(-slip_rate * dt / self.L_1)
        second = -np.expm1(-slip_rate * dt / self.L_2)
        theta_1 = state["theta_1"] + (self.C * normal_stress - state["theta_1"]) * first
        theta_2 = state["theta_2"] + (self.D * normal_stress - state["theta_2"]) * second
        inner = self.law.advance(state, slip_rate, theta_1 + theta_2, dt)
        return {**inner, "theta_1": theta_1, "theta_2": theta_2}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, state["theta_1"] + state["theta_2"], state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.law.steady_strength(slip_rate, (self.C + self.D) * normal_stress)
