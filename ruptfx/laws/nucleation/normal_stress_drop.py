"""Normal stress drop: sudden fluid pressure between the two sides, as by the plasma of an exploding wire."""

from __future__ import annotations

import numpy as np

from ruptfx.input.profiles.places import Center, HalfWidth, distance
from ruptfx.input.units import Duration, Instant, Strength, Time
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.pressurised import Pressurised
from ruptfx.laws.nucleation import Nucleation


class NormalStressDrop(Nucleation):
    """Normal stress drop: for a short time a fluid pressure reduces the normal stress in the friction of a patch."""

    center: Center
    """Middle of the patch."""
    half_width: HalfWidth
    """Half the length of the patch."""
    drop: Strength
    """Pressure of the fluid, subtracted from the normal stress in the friction law."""
    duration: Duration
    """Duration of the pressure."""
    begin: Instant = 0.0
    """Start of the pressure [s]."""
    rise: Time = 0.0
    """Duration of its rise and of its fall; 0: instantaneous."""

    @property
    def onset(self) -> float:
        return self.begin

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        near = distance(position, self.center) <= self.half_width * (1 + 1e-9)
        return Pressurised.model_construct(
            law=law,
            pressure=np.where(near, self.drop, 0.0),
            begin=self.begin,
            end=self.begin + self.duration,
            rise=self.rise,
        )
