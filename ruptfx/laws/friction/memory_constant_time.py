"""Memory of the normal stress with a constant relaxation time, around any law."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingTime
from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction._memory import Memory, approach


class MemoryConstantTime(Memory):
    """Normal-stress memory in constant-time form: the wrapped law uses theta_p, which follows sigma in the time t_c.

    Simple, and always smooth; but t_c is a length only after multiplication with a slip rate that grows without
    bound at the tip as the mesh is refined, so bimaterial pulses never become mesh-independent with it.
    """

    state_fields = {"theta_p": "Pa"}
    formula = "strength = law(V, theta_p); dtheta_p/dt = (sigma - theta_p) / t_c"
    source = "Prakash and Clifton (1993), relaxation at a constant rate; its limits: Scala, Festa, Vilotte (2017)"

    t_c: VaryingTime
    """Time in which the memory follows the normal stress."""

    def start(self, normal_stress: np.ndarray) -> LawState:
        return {"theta_p": normal_stress + 0.0}

    def follow(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {"theta_p": approach(state["theta_p"], normal_stress, dt / self.t_c)}
