"""Exponential velocity weakening."""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from ruptfx.input.schema import CaseError
from ruptfx.input.units import VaryingCoefficient, VaryingSpeed, VaryingSquaredSpeed
from ruptfx.laws.friction import Array, FrictionLaw, LawState

SMALLEST = 1e-30
"""Least mu_s - mu_d whose root is computed: at zero the slope of the root is infinite."""


class VelocityWeakening(FrictionLaw):
    """Velocity weakening: the coefficient falls exponentially from mu_s at rest to mu_d at speed, without memory.

    A case has either V_w or omega; with omega the slip rate V_w differs between points of different mu_s - mu_d.
    """

    example: ClassVar[str] = '{ kind = "velocity_weakening", mu_s = 0.6, mu_d = 0.2, V_w = 1.0 }'
    formula = "strength = [mu_d + (mu_s - mu_d) exp(-V / V_w)] sigma, V_w = sqrt(omega / (mu_s - mu_d))"
    source = "Kammer, Yastrebov, Spijker, Molinari (2012)"

    mu_s: VaryingCoefficient
    """Coefficient at rest."""
    mu_d: VaryingCoefficient
    """Coefficient at high slip rates."""
    V_w: VaryingSpeed | None = None
    """Slip rate over which it falls by 1/e."""
    omega: VaryingSquaredSpeed | None = None
    """Transition parameter (mu_s - mu_d) V_w^2 in place of V_w; mu_s must not be less than mu_d."""

    @model_validator(mode="after")
    def _one_slip_rate(self) -> Self:
        if (self.V_w is None) == (self.omega is None):
            present = "neither V_w nor" if self.omega is None else "both V_w and"
            raise ValueError(f"there is {present} omega; give one of them, for example V_w = 0.1")
        return self

    def at(self, position: np.ndarray) -> Self:
        law = super().at(position)
        least = float(np.min(np.subtract(law.mu_s, law.mu_d), initial=0.0))
        if law.omega is not None and least < 0:
            raise CaseError(
                f"{type(self).__name__}.omega: mu_s - mu_d is {least:.4g} somewhere, and must be 0 or more; raise "
                "mu_s, or give V_w"
            )
        return law

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        drop = self.mu_s - self.mu_d
        if self.V_w is not None:
            ratio = slip_rate / self.V_w
        else:
            ratio = slip_rate * np.sqrt(np.maximum(drop, SMALLEST) / self.omega)
        return (self.mu_d + drop * np.exp(-ratio)) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        return self.strength(slip_rate, normal_stress, {})
