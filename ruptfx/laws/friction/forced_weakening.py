"""Forced weakening around any law, for nucleation by a prescribed rupture or a sudden drop of friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingDelay, VaryingInstant
from ruptfx.laws.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.laws.friction.time_weakening import weakened_fraction

NEVER = 1e30  # s
LEAST = 1e-100  # Pa, below any pressure


class ForcedWeakening(FrictionLaw):
    """Forced weakening: from `arrival` to `end` the wrapped law is limited by a coefficient that falls to mu_d.

    It falls from the initial coefficient of the law, f_0, within t_w: the weaker of time weakening and the wrapped law
    acts, and the state of the wrapped law evolves independently. For linear slip weakening f_0 is mu_s, so that the
    coefficient is mu_s - (mu_s - mu_d) max(w, min(slip / D_c, 1)).
    """

    state_fields = {"clock": "s", "coefficient_at_start": "1"}
    formula = (
        "strength = min(law, [f_0 - (f_0 - mu_d) w] sigma) while arrival < t < end, else law; "
        "w = min((t - arrival) / t_w, 1)"
    )
    source = "Andrews (1985); forced rupture of the SCEC/USGS benchmarks, Harris et al. (2018)"

    law: AnyFriction
    """Wrapped law."""
    mu_d: VaryingCoefficient
    """Coefficient at the end of the forced weakening."""
    arrival: VaryingInstant
    """Time [s] at which weakening begins; before the start of the run where negative."""
    t_w: VaryingDelay = 0.0
    """Duration of the weakening; 0: instantaneous."""
    end: VaryingInstant = NEVER
    """Time [s] from which the wrapped law acts alone again."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        inner = self.law.initial_state(normal_stress, shear_stress, slip_rate)

        def at_rest(pressure: np.ndarray) -> Any:
            state = self.law.initial_state(pressure, shear_stress, slip_rate)
            return self.law.strength(0.0 * pressure, pressure, state)

        # An open point has no stress of its own: its coefficient is the slope of the strength with the pressure, at
        # pressures of the size of the cohesion, so that it has no unit.
        closed = normal_stress > 0
        pressure = np.where(closed, normal_stress, np.maximum(at_rest(np.where(closed, normal_stress, LEAST)), LEAST))
        strength = at_rest(pressure)
        strength = np.where(closed, strength, at_rest(2 * pressure) - strength)
        # A creeping law has no strength at rest: use its initial traction, and mu_d where it is open.
        without = np.where(closed, np.abs(shear_stress) / pressure, self.mu_d)
        start = np.where(strength > 0, strength / pressure, without)
        return {"clock": np.zeros_like(normal_stress), "coefficient_at_start": start, **inner}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        inner, start = self.law.strength(slip_rate, normal_stress, state), state["coefficient_at_start"]
        weakened = weakened_fraction(state["clock"], self.arrival, self.t_w)
        forced = ((1 - weakened) * start + weakened * self.mu_d) * normal_stress
        acts = np.where(state["clock"] < self.end, weakened, 0.0) > 0
        return np.where(acts, np.minimum(inner, forced), inner)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        inner = self.law.advance(state, slip_rate, normal_stress, dt)
        own = {"clock": state["clock"] + dt, "coefficient_at_start": state["coefficient_at_start"]}
        return {**inner, **own}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, normal_stress, state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        steady = self.law.steady_strength(slip_rate, normal_stress)
        return np.where(self.end < NEVER, steady, np.minimum(steady, self.mu_d * normal_stress))
