"""Rate and state friction, ageing law."""

from __future__ import annotations

import numpy as np

from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction.rate_and_state_base import RateAndState, decay_mean


class RateAndStateAgeing(RateAndState):
    """Rate and state with the ageing law: contacts strengthen with the time they last, also without slip."""

    formula = "strength = a sigma asinh(V/(2 V_0) exp((f_0 + b ln(V_0 theta/D_c))/a)); dtheta/dt = 1 - V theta/D_c"
    source = "Dieterich (1979); Ruina (1983); regularised as in Rice, Lapusta, Ranjith (2001)"

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        return 1 - np.abs(slip_rate) * theta / self.D_c

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate: theta exp(-x) + dt (1 - exp(-x)) / x, x = V dt / D_c.
        x = np.abs(slip_rate) * dt / self.D_c
        return {"theta": state["theta"] * np.exp(-x) + dt * decay_mean(x)}
