"""Trapezoidal softening, for ductile adhesives."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.plugin import Array, CohesiveLaw

PLATEAU = 0.3


class Trapezoidal(CohesiveLaw):
    """The strength lasts until a damage of 0.3, and falls linearly from there."""

    formula = "remaining = min(1, (1 - D) / 0.7)"
    source = "Tvergaard and Hutchinson (1992)"
    area: ClassVar[float] = 0.5 * (1 + PLATEAU)

    def remaining_fraction(self, damage: Array) -> Array:
        return np.minimum(1.0, (1.0 - damage) / (1.0 - PLATEAU))
