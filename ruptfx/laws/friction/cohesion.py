"""Cohesion in addition to any law."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingLength, VaryingPressure
from ruptfx.laws.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import Breakdown, RateDependence

NEVER = 1e30  # m


class Cohesion(FrictionLaw):
    """Cohesion: shear strength that does not depend on the normal stress, lost linearly over the slip D_cohesion.

    An open interface has no cohesion.
    """

    state_fields = {"cohesive_slip": "m"}
    formula = "strength = c max(1 - cohesive_slip / D_cohesion, 0) + law(V, sigma)"
    source = "Coulomb (1785); lost with slip as in Palmer and Rice (1973)"

    law: AnyFriction
    """Wrapped law."""
    c: VaryingPressure
    """Cohesion before any slip."""
    D_cohesion: VaryingLength = NEVER
    """Slip [m] at which the cohesion is lost; by default it is permanent."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        # The wrapped law carries the stress beyond the cohesion.
        frictional = np.maximum(np.abs(shear_stress) - self.c, 0.0)
        inner = self.law.initial_state(normal_stress, frictional, slip_rate)
        return {**inner, "cohesive_slip": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        bond = self.c * np.maximum(1 - state["cohesive_slip"] / self.D_cohesion, 0.0)
        return np.where(normal_stress > 0, bond, 0.0) + self.law.strength(slip_rate, normal_stress, state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        slip = state["cohesive_slip"] + slip_rate * dt
        return {**self.law.advance(state, slip_rate, normal_stress, dt), "cohesive_slip": slip}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        frictional = np.maximum(np.abs(shear_stress) - self.c, 0.0)
        return self.law.carried_slip_rate(frictional, normal_stress, state)

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown | RateDependence | None:
        """Return the lengths of the wrapped law; cohesion adds c to its peak and c D_cohesion / 2 to its energy.

        Permanent cohesion adds c to the residual instead.
        """
        inner = self.law.lengths(normal_stress, slip_rate)
        if not isinstance(inner, Breakdown):
            return inner
        bond = np.where(normal_stress > 0, self.c, 0.0)
        breaks = self.D_cohesion < NEVER
        return Breakdown(
            inner.peak + bond, inner.residual + np.where(breaks, 0.0, bond),
            inner.energy + np.where(breaks, 0.5 * bond * self.D_cohesion, 0.0),
        )  # fmt: skip
