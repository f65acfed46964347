"""Softening in two straight lines."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.fields import Array
from ruptfx.laws.cohesion import CohesiveLaw


class Bilinear(CohesiveLaw):
    """Strength falls to a third over the first 2/9 of the damage and to zero over the remainder, as in concrete.

    In openings: one third of the strength at 0.8 G_Ic / f_t, zero at 3.6 G_Ic / f_t.
    """

    formula = "remaining = max(1 - 3 D, 3/7 (1 - D))"
    source = "Petersson (1981)"
    area: ClassVar[float] = 5 / 18

    def remaining_fraction(self, damage: Array) -> Array:
        return np.maximum(1.0 - 3.0 * damage, (3 / 7) * (1.0 - damage))
