"""Normal stress drop: a fluid that suddenly presses the two sides apart, as the plasma of an exploding wire does."""

from __future__ import annotations

import numpy as np

from ruptfx.friction import FrictionLaw
from ruptfx.friction.pressurised import Pressurised
from ruptfx.nucleation import Nucleation
from ruptfx.places import Center, HalfWidth
from ruptfx.units import Duration, Instant, Strength, Time


class NormalStressDrop(Nucleation):
    """Normal stress drop: for a short time a fluid carries some of the normal stress of a patch."""

    center: Center
    """Middle of the patch."""
    half_width: HalfWidth
    """Half the length of the patch."""
    drop: Strength
    """Pressure of the fluid; what it has of the normal stress, friction has not."""
    duration: Duration
    """How long it stays."""
    begin: Instant = 0.0
    """When it comes [s]."""
    rise: Time = 0.0
    """Time its coming and its going take; 0: at once."""

    @property
    def onset(self) -> float:
        return self.begin

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        near = np.abs(position - self.center) <= self.half_width * (1 + 1e-9)
        return Pressurised.model_construct(
            law=law, pressure=np.where(near, self.drop, 0.0), begin=self.begin, end=self.begin + self.duration,
            rise=self.rise,
        )
