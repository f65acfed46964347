"""Shared part of the slip-weakening laws."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingLength
from ruptfx.laws.friction import Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import Breakdown


class SlipWeakening(FrictionLaw):
    """The coefficient falls from mu_s to mu_d with slip; laws differ in the remaining fraction of the drop."""

    state_fields = {"cumulative_slip": "m"}
    whole: ClassVar[float]
    """Integral of `left` over all ratios: fracture energy over drop and D_c."""

    mu_s: VaryingCoefficient
    """Static coefficient, at no slip."""
    mu_d: VaryingCoefficient
    """Dynamic coefficient, after much slip."""
    D_c: VaryingLength
    """Slip-weakening distance."""

    def remaining_fraction(self, ratio: Array) -> Array:
        """Return the remaining fraction of the drop after the slip `ratio` D_c, from 1 to 0."""
        raise NotImplementedError

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"cumulative_slip": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        remaining = self.remaining_fraction(state["cumulative_slip"] / self.D_c)
        return (self.mu_d + (self.mu_s - self.mu_d) * remaining) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {"cumulative_slip": state["cumulative_slip"] + slip_rate * dt}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.mu_d * normal_stress

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown:
        drop = (self.mu_s - self.mu_d) * normal_stress
        return Breakdown(self.mu_s * normal_stress, self.mu_d * normal_stress, self.whole * drop * self.D_c)
