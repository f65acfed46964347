"""Forced rupture: friction that drops behind a front of given speed."""

from __future__ import annotations

import numpy as np

from ruptfx.input.profiles import evaluate
from ruptfx.input.profiles.places import Center, HalfWidth, distance
from ruptfx.input.units import Instant, Speed, Time, VaryingCoefficient
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.forced_weakening import NEVER, ForcedWeakening
from ruptfx.laws.nucleation import Nucleation


class ForcedRupture(Nucleation):
    """Forced rupture: within `radius` of the center friction falls to mu_d, in t_w behind a front of given speed.

    The weaker of law and forced weakening acts, so that the rupture may outrun the forced front.
    """

    center: Center
    """Start of the forced front."""
    radius: HalfWidth
    """Distance that the forced front runs."""
    speed: Speed
    """Speed of the front."""
    mu_d: VaryingCoefficient
    """Coefficient behind the front."""
    t_w: Time = 0.0
    """Duration of the fall; 0: instantaneous."""
    start: Instant = 0.0
    """Time [s] at which the front leaves the center; negative: it has started before t = 0."""
    end: Instant = NEVER
    """Time [s] at which the forcing ends."""

    @property
    def onset(self) -> float:
        return self.start

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        away = distance(position, self.center)
        arrival = self.start + away / self.speed
        arrival = np.where(away <= self.radius * (1 + 1e-9), arrival, NEVER)
        mu_d = evaluate(self.mu_d, position) if callable(self.mu_d) else self.mu_d
        return ForcedWeakening.model_construct(law=law, mu_d=mu_d, arrival=arrival, t_w=self.t_w, end=self.end)
