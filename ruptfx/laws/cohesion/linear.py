"""Linear softening."""

from __future__ import annotations

from typing import ClassVar

from ruptfx.input.fields import Array
from ruptfx.laws.cohesion import CohesiveLaw


class Linear(CohesiveLaw):
    """Strength falls linearly with inelastic opening and slip."""

    formula = "remaining = 1 - D"
    source = "Camacho and Ortiz (1996)"
    area: ClassVar[float] = 0.5

    def remaining_fraction(self, damage: Array) -> Array:
        return 1.0 - damage
