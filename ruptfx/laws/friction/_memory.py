"""Shared part of the memories of the normal stress."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.laws.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import Breakdown, RateDependence


class Memory(FrictionLaw):
    """The wrapped law uses the remembered normal stress, the sum of the state fields, as its normal stress."""

    law: AnyFriction
    """Wrapped law."""

    def start(self, normal_stress: np.ndarray) -> LawState:
        """Return the own state fields before the first slip [Pa]."""
        raise NotImplementedError

    def follow(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        """Return the own state fields after a step [Pa]."""
        raise NotImplementedError

    def share(self) -> Array:
        """Return remembered over acting normal stress at steady state."""
        return 1.0

    def remembered(self, state: LawState) -> Any:
        """Return the remembered normal stress [Pa]."""
        return sum(state[name] for name in self.state_fields)

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        own = self.start(normal_stress)
        return {**self.law.initial_state(self.remembered(own), shear_stress, slip_rate), **own}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        # An open interface has no strength, whatever the remembered stress.
        return self.law.strength(slip_rate, np.where(normal_stress > 0, self.remembered(state), 0.0), state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        own = self.follow(state, slip_rate, normal_stress, dt)
        return {**self.law.advance(state, slip_rate, self.remembered(own), dt), **own}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, self.remembered(state), state)

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown | RateDependence | None:
        """Return the lengths of the wrapped law at the steady remembered stress."""
        return self.law.lengths(self.share() * normal_stress, slip_rate)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.law.steady_strength(slip_rate, self.share() * normal_stress)


def approach(value: Array, goal: Array, times: Array) -> Array:
    """Return `value` after exponential relaxation towards `goal` for `times` relaxation times; exact."""
    return value - (goal - value) * np.expm1(-times)
