"""Linear softening with a fracture energy that depends on the mix of modes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.fields import Array
from ruptfx.input.units import Positive
from ruptfx.laws.cohesion import CohesiveLaw


class BenzeggaghKenane(CohesiveLaw):
    """Linear softening; at constant mode mix the fracture energy is the measured interpolation of both modes."""

    formula = "remaining = 1 - D, D = (f_t w + c s) / (2 G), G = G_Ic + (G_IIc - G_Ic) B^eta, B = c s / (f_t w + c s)"
    source = "Benzeggagh and Kenane (1996)"
    area: ClassVar[float] = 0.5

    eta: Positive = 2.0
    """Exponent of the share of mode II."""

    def remaining_fraction(self, damage: Array) -> Array:
        return 1.0 - damage

    def damage(self, opening: Array, slip: Array) -> Array:
        normal, shear = self.f_t * opening, self.c * slip
        both = normal + shear
        part = shear / np.where(both > 0, both, 1.0)
        energy = self.G_Ic + (self.G_IIc - self.G_Ic) * part**self.eta
        return np.minimum(self.area * both / energy, 1.0)
