"""The softening curve of combined finite and discrete elements."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.fields import Array
from ruptfx.laws.cohesion import CohesiveLaw

_A, _B, _C = 0.63, 1.8, 6.0


class Munjiza(CohesiveLaw):
    """The curve of combined finite and discrete elements, fitted to concrete in direct tension; flat at the start."""

    formula = (
        "remaining = (1 - (a+b-1)/(a+b) exp(D (a + c b)/((a+b)(1-a-b)))) (a (1-D) + b (1-D)^c), a = 0.63, b = 1.8, "
        "c = 6"
    )
    source = "Munjiza, Andrews and White (1999); data of Evans and Marathe (1968)"
    area: ClassVar[float] = 0.38630729474394326

    def remaining_fraction(self, damage: Array) -> Array:
        rate = (_A + _C * _B) / ((_A + _B) * (1 - _A - _B))
        rise = 1 - (_A + _B - 1) / (_A + _B) * np.exp(rate * damage)
        # At D = 0 the two factors are 1 / (a + b) and a + b.
        return rise * (_A * (1.0 - damage) + _B * (1.0 - damage) ** 6)
