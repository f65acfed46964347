"""Rate and state friction, slip law."""

from __future__ import annotations

import numpy as np

from ruptfx.laws.friction import AT_REST, Array, LawState
from ruptfx.laws.friction.rate_and_state_base import RateAndState


class RateAndStateSlip(RateAndState):
    """Rate and state with the slip law: contacts change only by slip, over the distance D_c."""

    formula = (
        "strength = a sigma asinh(V/(2 V_0) exp((f_0 + b ln(V_0 theta/D_c))/a)); "
        "dtheta/dt = -(V theta/D_c) ln(V theta/D_c)"
    )
    source = "Ruina (1983); regularised as in Rice, Lapusta, Ranjith (2001)"

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        ratio = np.maximum(np.abs(slip_rate), AT_REST) * theta / self.D_c
        return -ratio * np.log(ratio)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate: ln(V theta / D_c) decays as exp(-V dt / D_c).
        speed = np.maximum(np.abs(slip_rate), AT_REST)
        distance = np.log(speed * state["theta"] / self.D_c)
        return {"theta": state["theta"] * np.exp(np.expm1(-speed * dt / self.D_c) * distance)}
