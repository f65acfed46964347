"""Drag of rough surfaces in addition to any law."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingDrag
from ruptfx.laws.friction import AnyFriction, Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import Breakdown, RateDependence


class RoughnessDrag(FrictionLaw):
    """Roughness drag: shear resistance that grows with slip, as surfaces that are not flat stress the bodies.

    Over a self-similar fault profile with the amplitude-to-wavelength ratio alpha and the shortest wavelength l,
    tau_drag = 8 pi^3 alpha^2 G slip / ((1 - nu) l); `drag` is that per slip and normal stress.
    """

    state_fields = {"drag_slip": "m"}
    formula = "strength = law(V, sigma) + drag drag_slip sigma"
    source = "Fang and Dunham (2013)"

    law: AnyFriction
    """Wrapped law."""
    drag: VaryingDrag
    """Growth of the friction coefficient per slip."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        inner = self.law.initial_state(normal_stress, shear_stress, slip_rate)
        return {**inner, "drag_slip": np.zeros_like(normal_stress)}

    def _drag(self, normal_stress: Array, state: LawState) -> Array:
        return self.drag * state["drag_slip"] * normal_stress

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return self.law.strength(slip_rate, normal_stress, state) + self._drag(normal_stress, state)

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        slip = state["drag_slip"] + slip_rate * dt
        return {**self.law.advance(state, slip_rate, normal_stress, dt), "drag_slip": slip}

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        frictional = np.maximum(np.abs(shear_stress) - self._drag(normal_stress, state), 0.0)
        return self.law.carried_slip_rate(frictional, normal_stress, state)

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown | RateDependence | None:
        """Return the lengths of a wrapped law that depends on the rate; None for others, as drag leaves no residual."""
        inner = self.law.lengths(normal_stress, slip_rate)
        return None if isinstance(inner, Breakdown) else inner
