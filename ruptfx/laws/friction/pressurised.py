"""A fluid between the surfaces around any law: effect of the nucleation `normal_stress_drop`."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingDelay, VaryingInstant, VaryingPressure
from ruptfx.laws.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.laws.friction.time_weakening import weakened_fraction

NEVER = 1e30  # s


class Pressurised(FrictionLaw):
    """A fluid in the interface: for a time its pressure reduces the normal stress in the friction law.

    The traction on the bodies remains the total normal stress; a pressure above it would open the interface, but only
    removes its friction here.
    """

    state_fields = {"clock": "s"}
    formula = "strength = law at the normal stress max(sigma - pressure w, 0); w rises from begin on, falls from end on"
    source = "effective stress, Terzaghi (1925)"

    law: AnyFriction
    """Wrapped law, which uses the effective normal stress."""
    pressure: VaryingPressure
    """Pressure of the fluid."""
    begin: VaryingInstant = 0.0
    """Time [s] at which the pressure rises; before the start of the run if negative."""
    end: VaryingInstant = NEVER
    """Time [s] at which the pressure falls."""
    rise: VaryingDelay = 0.0
    """Duration of its rise and of its fall; 0: instantaneous."""

    def _left(self, normal_stress: Array, clock: Array) -> Array:
        there = weakened_fraction(clock, self.begin, self.rise) - weakened_fraction(clock, self.end, self.rise)
        return np.maximum(normal_stress - self.pressure * there, 0.0)

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        inner = self.law.initial_state(normal_stress, shear_stress, slip_rate)
        return {"clock": np.zeros_like(normal_stress), **inner}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.strength(slip_rate, self._left(normal_stress, state["clock"]), state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        inner = self.law.advance(state, slip_rate, self._left(normal_stress, state["clock"]), dt)
        return {**inner, "clock": state["clock"] + dt}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, self._left(normal_stress, state["clock"]), state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        lasting = np.where(self.end < NEVER, 0.0, self.pressure)
        return self.law.steady_strength(slip_rate, np.maximum(normal_stress - lasting, 0.0))
