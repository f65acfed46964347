"""Part of a sphere, or of a cylinder along a line."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import PositiveMetre, Profile, Value
from ruptfx.input.profiles.places import Center
from ruptfx.input.quantities import at_least
from ruptfx.input.schema import CaseError


class Sphere(Profile):
    """`tip + radius - sqrt(radius^2 - (position - center)^2)`: lower half of a sphere, or of a cylinder."""

    radial: ClassVar[bool] = True
    example: ClassVar[str] = '{ kind = "sphere", radius = 2.0, center = 0.1, tip = 0.01 }'
    radius: PositiveMetre
    """Radius of the sphere, larger than the distance of any point from the center."""
    center: Center
    """Position of the tip."""
    tip: Value = 0.0
    """Value at the center."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        away = np.abs(position - self.center)
        if len(away) and away.max() >= self.radius:
            raise CaseError(
                f"radius = {self.radius:g} m: there are points up to {at_least(away.max())} m from the center, beyond "
                "the sphere; make radius larger, or the surface smaller"
            )
        # The same as radius - sqrt(...) without the difference of two large numbers.
        return self.tip + away**2 / (self.radius + np.sqrt(self.radius**2 - away**2))
