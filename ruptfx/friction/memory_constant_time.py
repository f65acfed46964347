"""Memory of the normal stress with a constant relaxation time, around any law."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.units import VaryingTime


class MemoryConstantTime(FrictionLaw):
    """Normal-stress memory in constant-time form: the held law sees theta_p, which follows sigma within the time t_c.

    Simple, and always smooth; but t_c is a length only after multiplication with a slip rate that grows without
    bound at the tip as the mesh is refined, so bimaterial pulses never become mesh-independent with it.
    """

    state_fields = {"theta_p": "Pa"}
    formula = "strength = law(V, theta_p); dtheta_p/dt = (sigma - theta_p) / t_c"
    source = "Prakash and Clifton (1993), relaxation at a constant rate; its limits: Scala, Festa, Vilotte (2017)"

    law: AnyFriction
    t_c: VaryingTime

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {**self.law.initial_state(normal_stress, shear_stress, slip_rate), "theta_p": normal_stress + 0.0}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        # An open interface carries nothing, whatever it remembers.
        return self.law.strength(slip_rate, np.where(normal_stress > 0, state["theta_p"], 0.0), state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant normal stress.
        theta_p = state["theta_p"] - (normal_stress - state["theta_p"]) * np.expm1(-dt / self.t_c)
        return {**self.law.advance(state, slip_rate, theta_p, dt), "theta_p": theta_p}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, state["theta_p"], state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.law.steady_strength(slip_rate, normal_stress)
