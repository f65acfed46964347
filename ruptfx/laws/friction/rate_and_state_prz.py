"""Rate and state friction, evolution law of Perrin, Rice and Zheng."""

from __future__ import annotations

import numpy as np

from ruptfx.laws.friction import Array, LawState
from ruptfx.laws.friction.rate_and_state_base import RateAndState


def tanh_mean(x: Array) -> Array:
    """Return tanh(x) / x for x >= 0, with its limit 1 at x = 0 and exact derivatives there."""
    large = np.maximum(x, 1e-3)
    return np.where(x < 1e-3, 1 - x * x / 3 + 2 * x**4 / 15, np.tanh(large) / large)


class RateAndStatePrz(RateAndState):
    """Rate and state of Perrin, Rice and Zheng: contacts age at rest, and near steady sliding as in the slip law.

    In steady sliding theta is 2 D_c / V, twice that of the other laws; f_0 is the steady coefficient at V_0 all the
    same. After a small step of the slip rate friction decays over D_c.
    """

    formula = (
        "strength = a sigma asinh(V/(2 V_0) exp((f_0 + b ln(V_0 theta/(2 D_c)))/a)); "
        "dtheta/dt = 1 - [V theta/(2 D_c)]^2"
    )
    source = "Perrin, Rice, Zheng (1995), J. Mech. Phys. Solids 43, 1461-1495; regularised as in Rice, Lapusta, Ranjith"

    def contact(self, theta: Array) -> Array:
        return self.b * np.log(self.V_0 * theta / (2 * self.D_c))

    def age(self, contact: Array) -> Array:
        return 2 * self.D_c / self.V_0 * np.exp(contact / self.b)

    def steady_age(self, slip_rate: Array) -> Array:
        return 2 * self.D_c / slip_rate

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        return 1 - (np.abs(slip_rate) * theta / (2 * self.D_c)) ** 2

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate: u = V theta / (2 D_c) is tanh(artanh u + x), x = V dt / (2 D_c).
        rate = np.abs(slip_rate) / (2 * self.D_c)
        x, theta = rate * dt, state["theta"]
        return {"theta": (theta + dt * tanh_mean(x)) / (1 + rate * theta * np.tanh(x))}
