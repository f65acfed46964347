"""Prakash-Clifton memory of the normal stress, around any law."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingLength, VaryingRatio, VaryingVelocity
from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction._memory import Memory, approach


class PrakashClifton(Memory):
    """Normal-stress memory: the wrapped law uses theta_p, which follows D sigma over the slip L_p, instead of sigma.

    The default regularisation between different materials, where plain Coulomb friction has no solution: slip on a
    length that the mesh can resolve, whatever the slip rate.
    """

    state_fields = {"theta_p": "Pa"}
    formula = "strength = law(V, theta_p); dtheta_p/dt = -(theta_p - D sigma) (V + V_star) / L_p"
    source = "Prakash and Clifton (1993); Prakash (1998); with V_star: Cochard and Rice (2000)"

    L_p: VaryingLength
    """Slip over which the memory follows the normal stress."""
    D: VaryingRatio = 1.0
    """Share of the normal stress that the memory tends to."""
    theta_p_ratio: VaryingRatio = 1.0
    """Initial theta_p / (D sigma); below 1 the interface starts weak and strengthens as it slips."""
    V_star: VaryingVelocity = 0.0
    """Added to the slip rate, so that the memory also fades at rest, within L_p / V_star."""

    def share(self) -> Array:
        return self.D

    def start(self, normal_stress: np.ndarray) -> LawState:
        return {"theta_p": self.theta_p_ratio * self.D * normal_stress}

    def follow(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        times = (slip_rate + self.V_star) * dt / self.L_p
        return {"theta_p": approach(state["theta_p"], self.D * normal_stress, times)}
