"""Forces at a point of the bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from ruptfx.bodies.boundaries import Action, Force, check_vector
from ruptfx.bodies.boundaries._at_point import AtPoint
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads


class PointForce(AtPoint):
    """Force at a point, inside the bodies or on an edge; in 2D on a line, per length of it [N/m].

    The force uses the shape functions of the element at the point, so that the point need not be a node. The field is
    not resolved within about one element of the point.
    """

    example: ClassVar[str] = '{ kind = "point_force", point = [5.3e-3, 2.2e-3], force = [1e3, -2e3], ramp = 3e-6 }'

    force: Annotated[list[float], Field(min_length=1, max_length=3), Unit("N")]
    """One component for each direction in which the plane moves."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.point", self.point, "xyz" if plane == "solid" else "xy")
        check_vector(f"{key}.force", self.force, components)

    def act(self, loads: Loads, key: str) -> Action:
        place = loads.inside(self.point, self.body, key)
        return Action(force=Force.of(place.force(self.force), self.factor))
