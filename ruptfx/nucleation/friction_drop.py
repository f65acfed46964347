"""Friction drop: a sudden change of friction in a patch."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import FrictionLaw
from ruptfx.friction.forced_weakening import ForcedWeakening
from ruptfx.nucleation import Nucleation
from ruptfx.nucleation.forced_rupture import NEVER
from ruptfx.units import Coordinate, Length, NonNegative, Time


class FrictionDrop(Nucleation):
    """Friction drop: at a given time the coefficient falls to mu_d, at once or within t_w, in a patch."""

    center: Coordinate
    half_width: Length
    mu_d: NonNegative = 0.0
    time: Time = 0.0
    t_w: Time = 0.0

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        near = np.abs(position - self.center) <= self.half_width * (1 + 1e-9)
        arrival = np.where(near, self.time, NEVER)
        return ForcedWeakening.model_construct(law=law, mu_d=self.mu_d, arrival=arrival, t_w=self.t_w)
