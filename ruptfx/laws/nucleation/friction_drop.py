"""Friction drop: a sudden change of friction in a patch."""

from __future__ import annotations

import numpy as np

from ruptfx.input.profiles.places import Center, HalfWidth, distance
from ruptfx.input.units import Instant, NonNegative, Time
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.forced_weakening import NEVER, ForcedWeakening
from ruptfx.laws.nucleation import Nucleation


class FrictionDrop(Nucleation):
    """Friction drop: at a given time the coefficient falls to mu_d, at once or within t_w, in a patch."""

    center: Center
    """Middle of the patch."""
    half_width: HalfWidth
    """Half the length of the patch."""
    mu_d: NonNegative = 0.0
    """Coefficient in the patch afterwards."""
    time: Instant = 0.0
    """Start of the drop [s]; negative: it has started, or ended, before t = 0."""
    t_w: Time = 0.0
    """Duration of the fall; 0: instantaneous."""
    end: Instant = NEVER
    """Time [s] at which the forcing ends."""

    @property
    def onset(self) -> float:
        return self.time

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        near = distance(position, self.center) <= self.half_width * (1 + 1e-9)
        arrival = np.where(near, self.time, NEVER)
        return ForcedWeakening.model_construct(law=law, mu_d=self.mu_d, arrival=arrival, t_w=self.t_w, end=self.end)
