"""Time weakening: a rupture whose speed is prescribed."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingDelay
from ruptfx.laws.friction import Array, FrictionLaw, LawState


class TimeWeakening(FrictionLaw):
    """Time weakening: the coefficient falls from mu_s to mu_d within t_w of the arrival of a prescribed rupture.

    With `arrival` a profile of kind `cone`, |position - center| / v, the rupture runs both ways at the speed v. With
    t_w = 0 the drop is sudden, the self-similar crack.
    """

    state_fields = {"clock": "s"}
    formula = "strength = [mu_s - (mu_s - mu_d) min(max((t - arrival) / t_w, 0), 1)] sigma"
    source = "Kostrov (1966), prescribed rupture speed; Andrews (1985), time weakening"

    mu_s: VaryingCoefficient
    """Coefficient before the arrival."""
    mu_d: VaryingCoefficient
    """Coefficient after it."""
    arrival: VaryingDelay
    """Time [s] after the start at which weakening begins."""
    t_w: VaryingDelay = 0.0
    """Duration of the fall; 0: instantaneous."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"clock": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        weakened = weakened_fraction(state["clock"], self.arrival, self.t_w)
        return (self.mu_s - (self.mu_s - self.mu_d) * weakened) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {"clock": state["clock"] + dt}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.mu_d * normal_stress


def weakened_fraction(clock: Array, arrival: Array, duration: Array) -> Array:
    """Return 0 until `arrival`, then a linear rise to 1 within `duration` (a jump if that is zero)."""
    return np.minimum(np.maximum((clock - arrival) / np.maximum(duration, 1e-30), 0.0), 1.0)
