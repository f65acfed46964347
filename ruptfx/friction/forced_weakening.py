"""Forced weakening around any law: how nucleation by a prescribed rupture or a sudden drop of friction acts."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.friction.time_weakening import weakened_fraction
from ruptfx.units import VaryingCoefficient, VaryingDelay


class ForcedWeakening(FrictionLaw):
    """Forced weakening: from a given time on the held law's strength is lowered, within t_w, to at most mu_d sigma.

    It never strengthens the interface, so that the held law goes on unaware and rules wherever it is weaker.
    """

    state_fields = {"clock": "s"}
    formula = "strength = (1 - w) law + w min(law, mu_d sigma), w = min(max((t - arrival) / t_w, 0), 1)"
    source = "Andrews (1985); forced rupture of the SCEC/USGS benchmarks, Harris et al. (2018)"

    law: AnyFriction
    mu_d: VaryingCoefficient
    arrival: VaryingDelay
    t_w: VaryingDelay = 0.0

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {**self.law.initial_state(normal_stress, shear_stress, slip_rate), "clock": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        held = self.law.strength(slip_rate, normal_stress, state)
        weakened = weakened_fraction(state["clock"], self.arrival, self.t_w)
        return (1 - weakened) * held + weakened * np.minimum(held, self.mu_d * normal_stress)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {**self.law.advance(state, slip_rate, normal_stress, dt), "clock": state["clock"] + dt}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, normal_stress, state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return np.minimum(self.law.steady_strength(slip_rate, normal_stress), self.mu_d * normal_stress)
