"""Rate and state friction, ageing that saturates at short contact times."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingTime
from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction.rate_and_state_base import RateAndState, decay_mean


class RateAndStateSaturating(RateAndState):
    """Rate and state with saturating ageing: contacts younger than theta_c do not weaken further.

    The contribution of the age is b ln(1 + theta / theta_c): the critical stiffness falls with V and friction
    strengthens with speed once b < a (1 + V theta_c / D_c).
    """

    formula = "strength = a sigma asinh(V/(2 V_0) exp((f_0 + b ln(1 + theta/theta_c))/a)); dtheta/dt = 1 - V theta/D_c"
    source = "Dieterich (1979), cutoff time; Baumberger and Caroli (2006), review in Advances in Physics 55"

    theta_c: VaryingTime
    """Age below which contacts weaken no further."""

    def contact(self, theta: Array) -> Array:
        return self.b * np.log1p(theta / self.theta_c)

    def contact_slope(self, theta: Array) -> Array:
        return self.b * theta / (theta + self.theta_c)

    def age(self, contact: Array) -> Array:
        # The contribution cannot be negative: a stress below that of new contacts gives the smallest age.
        return self.theta_c * np.expm1(np.maximum(contact / self.b, 1e-9))

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        return 1 - np.abs(slip_rate) * theta / self.D_c

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate: theta exp(-x) + dt (1 - exp(-x)) / x, x = V dt / D_c.
        x = np.abs(slip_rate) * dt / self.D_c
        return {"theta": state["theta"] * np.exp(-x) + dt * decay_mean(x)}
