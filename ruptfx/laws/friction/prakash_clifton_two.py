"""Prakash-Clifton memory of the normal stress with two variables, around any law."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingLength, VaryingRatio
from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction._memory import Memory, approach


class PrakashCliftonTwo(Memory):
    """Two-stage memory of the normal stress: the wrapped law uses theta_1 + theta_2.

    theta_1 approaches C sigma over the slip L_1 and theta_2 approaches D sigma over L_2: a step of normal stress acts
    partly over the shorter, partly over the longer slip.
    """

    state_fields = {"theta_1": "Pa", "theta_2": "Pa"}
    formula = (
        "strength = law(V, theta_1 + theta_2); dtheta_1/dt = -(theta_1 - C sigma) V / L_1, "
        "dtheta_2/dt = -(theta_2 - D sigma) V / L_2"
    )
    source = "Prakash (1998); Coker, Lykotrafitis, Needleman, Rosakis (2005)"

    L_1: VaryingLength
    """Slip over which the first memory follows."""
    L_2: VaryingLength
    """Slip over which the second memory follows."""
    C: VaryingRatio = 0.5
    """Share of the normal stress that the first memory tends to."""
    D: VaryingRatio = 0.5
    """Share of the normal stress that the second memory tends to."""
    theta_1_ratio: VaryingRatio = 1.0
    """Initial theta_1 / (C sigma)."""
    theta_2_ratio: VaryingRatio = 1.0
    """Initial theta_2 / (D sigma)."""

    def share(self) -> Array:
        return self.C + self.D

    def start(self, normal_stress: np.ndarray) -> LawState:
        shares = {"theta_1": self.theta_1_ratio * self.C, "theta_2": self.theta_2_ratio * self.D}
        return {name: share * normal_stress for name, share in shares.items()}

    def follow(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {
            "theta_1": approach(state["theta_1"], self.C * normal_stress, slip_rate * dt / self.L_1),
            "theta_2": approach(state["theta_2"], self.D * normal_stress, slip_rate * dt / self.L_2),
        }
