"""Coulomb friction."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingCoefficient
from ruptfx.laws.friction import Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import Breakdown


class Coulomb(FrictionLaw):
    """Coulomb friction: the strength is proportional to the normal stress."""

    formula = "strength = mu_d sigma"
    source = "Coulomb (1785)"

    mu_d: VaryingCoefficient
    """Friction coefficient."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return self.mu_d * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.mu_d * normal_stress

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown:
        """Return a breakdown without drop and energy."""
        return Breakdown(self.mu_d * normal_stress, self.mu_d * normal_stress, 0.0 * normal_stress)
