"""Weight of the bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import Action, Boundary, Force, check_vector
from ruptfx.bodies.boundaries.histories import ramp
from ruptfx.bodies.space.mirror import reversed_components
from ruptfx.input.schema import CaseError, Unit
from ruptfx.input.units import Time
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads


class Gravity(Boundary):
    """Body force on all bodies, density times an acceleration, in addition to the load of the initial stress.

    The force uses the same quadrature as the mass, so that free bodies fall rigidly.
    """

    example: ClassVar[str] = '{ kind = "gravity", acceleration = [1e5, -3e5], ramp = 2e-6 }'
    amounts: ClassVar[tuple[str, ...]] = ("acceleration", "ramp")

    acceleration: Annotated[list[float], Field(min_length=1, max_length=3), Unit("m/s2")]
    """One component for each direction in which the plane moves; [0, -9.81] on Earth."""
    ramp: Time = 0.0
    """Time over which the acceleration grows linearly from zero."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.acceleration", self.acceleration, components)

    def act(self, loads: Loads, key: str) -> Action:
        turned = reversed_components(loads.model)
        names = {1: "z", 2: "xy", 3: "xyz"}[loads.model.components]
        for name, size in zip(names, self.acceleration, strict=True):
            if size and name in turned:
                raise CaseError(
                    f"{key}.acceleration = {self.acceleration}: along {name} the mirror image of a half model would "
                    "fall the opposite way; make the whole, without half or with two plates"
                )
        mass = loads.model.mass.reshape(-1, loads.model.components)
        weight = (mass * np.array(self.acceleration)).ravel()
        return Action(force=Force.of(weight, lambda time: ramp(time, self.ramp)))
