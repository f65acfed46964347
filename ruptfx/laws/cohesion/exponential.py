"""Exponential softening."""

from __future__ import annotations

from math import log
from typing import ClassVar

import numpy as np

from ruptfx.input.fields import Array
from ruptfx.laws.cohesion import CohesiveLaw

_END = 1e-3  # of the strength, where the tail is cut
_RATE = -log(_END)


class Exponential(CohesiveLaw):
    """Strength falls exponentially; the tail is cut at a thousandth, and the curve shifted to end at 0."""

    formula = "remaining = (exp(-a D) - exp(-a)) / (1 - exp(-a)), a = ln 1000"
    source = "after Xu and Needleman (1994), without the rise before the peak"
    area: ClassVar[float] = 1 / _RATE - _END / (1 - _END)

    def remaining_fraction(self, damage: Array) -> Array:
        return (np.exp(-_RATE * damage) - _END) / (1 - _END)
