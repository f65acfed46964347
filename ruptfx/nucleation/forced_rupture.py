"""Forced rupture: friction that drops behind a front of given speed."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import FrictionLaw
from ruptfx.friction.forced_weakening import ForcedWeakening
from ruptfx.nucleation import Nucleation
from ruptfx.units import Coordinate, Length, Speed, Time, VaryingCoefficient

NEVER = 1e30  # s


class ForcedRupture(Nucleation):
    """Forced rupture: within `radius` of the center friction falls to mu_d, in t_w behind a front of given speed.

    Where the law is weaker on its own it rules, so that the rupture may outrun the forced front.
    """

    center: Coordinate
    radius: Length
    speed: Speed
    mu_d: VaryingCoefficient
    t_w: Time = 0.0

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        distance = np.abs(position - self.center)
        arrival = np.where(distance <= self.radius * (1 + 1e-9), distance / self.speed, NEVER)
        return ForcedWeakening.model_construct(law=law, mu_d=_at(self.mu_d, position), arrival=arrival, t_w=self.t_w)


def _at(value: VaryingCoefficient, position: np.ndarray) -> VaryingCoefficient:
    return value(position) if callable(value) else value
