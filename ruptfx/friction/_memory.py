"""What the memories of the normal stress share."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.friction._lengths import Breakdown, RateDependence


class Memory(FrictionLaw):
    """The held law sees the remembered normal stress, the sum of the state fields, instead of the normal stress."""

    law: AnyFriction
    """The law that is held."""

    def start(self, normal_stress: np.ndarray) -> LawState:
        """Own state fields before the first slip [Pa]."""
        raise NotImplementedError

    def follow(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        """Own state fields after a step [Pa]."""
        raise NotImplementedError

    def share(self) -> Array:
        """Remembered over acting normal stress in the long run."""
        return 1.0

    def remembered(self, state: LawState) -> Array:
        return sum(state[name] for name in self.state_fields)

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        own = self.start(normal_stress)
        return {**self.law.initial_state(self.remembered(own), shear_stress, slip_rate), **own}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        # An open interface carries nothing, whatever it remembers.
        return self.law.strength(slip_rate, np.where(normal_stress > 0, self.remembered(state), 0.0), state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        own = self.follow(state, slip_rate, normal_stress, dt)
        return {**self.law.advance(state, slip_rate, self.remembered(own), dt), **own}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, self.remembered(state), state)

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown | RateDependence | None:
        """Those of the held law where the memory has caught up."""
        return self.law.lengths(self.share() * normal_stress, slip_rate)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.law.steady_strength(slip_rate, self.share() * normal_stress)


def approach(value: Array, goal: Array, times: Array) -> Array:
    """What relaxes towards `goal` for `times` relaxation times: exact."""
    return value - (goal - value) * np.expm1(-times)
