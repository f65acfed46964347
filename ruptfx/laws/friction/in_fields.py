"""A friction law in the fields of its interface: it reads the effective normal stress and the temperature."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.input.fields import INTERFACE_FIELDS
from ruptfx.laws.friction import AnyFriction, Array, FrictionLaw, LawState


def rate_of(name: str) -> str:
    """Return the name of the rate of a field."""
    return f"{name}_rate"


class InFields(FrictionLaw):
    """A law and the fields of its interface, which are states that change at known rates over a step.

    The step sets the rates (`ruptfx.interfaces.faults.fields`), so that a law has a field of second order at every time
    within the step. The traction on the bodies remains the total normal stress.
    """

    law: AnyFriction
    """Law that reads the effective normal stress, and the state `temperature` where it has one."""
    initial: Any
    """Initial values of the fields by name, shape (n,)."""
    is_heated: bool = False
    """Whether heat of friction changes a field; the state `frictional_heat` then adds it up [J/m2]."""

    def _own(self) -> list[str]:
        names = [each for name in self.initial for each in (name, rate_of(name))]
        return [*names, "frictional_heat"] if self.is_heated else names

    def all_state_fields(self) -> dict[str, str]:
        return {**self.law.all_state_fields(), **{name: INTERFACE_FIELDS[name].unit for name in self._own()}}

    def effective(self, normal_stress: Array, pressure: Array) -> Array:
        """Return the effective normal stress [Pa], not negative."""
        return np.maximum(normal_stress - pressure, 0.0) if "pore_pressure" in self.initial else normal_stress

    def _stress(self, normal_stress: Array, state: LawState) -> Array:
        return self.effective(normal_stress, state.get("pore_pressure", 0.0))

    def _initial_stress(self, normal_stress: Any) -> Any:
        return self.effective(normal_stress, self.initial.get("pore_pressure", 0.0))

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        inner = self.law.initial_state(self._initial_stress(normal_stress), shear_stress, slip_rate)
        zero = np.zeros_like(normal_stress)
        return {**inner, **dict.fromkeys(self._own(), zero), **{k: zero + v for k, v in self.initial.items()}}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.strength(slip_rate, self._stress(normal_stress, state), state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        inner = self.law.advance(state, slip_rate, self._stress(normal_stress, state), dt)
        own = {name: state[name] for name in self._own()}
        return {**inner, **own, **{name: state[name] + state[rate_of(name)] * dt for name in self.initial}}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.carried_slip_rate(shear_stress, self._stress(normal_stress, state), state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.law.steady_strength(slip_rate, self._initial_stress(normal_stress))

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Any:
        return self.law.lengths(self._initial_stress(normal_stress), slip_rate)
