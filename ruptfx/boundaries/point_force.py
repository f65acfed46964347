"""Forces at a point of the bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from ruptfx.boundaries import Action, Boundary, Force, check_vector
from ruptfx.boundaries._history import History, course
from ruptfx.materials import Plane
from ruptfx.schema import Unit
from ruptfx.units import Time

if TYPE_CHECKING:
    from ruptfx.loading import Loads


class PointForce(Boundary):
    """A force at a point, inside or on an edge; in two dimensions on a line, per length of it [N/m].

    It acts on the shape functions of the element at the point, so that the point need not be a node. Nearer than about
    one element the field is that of the elements.
    """

    example: ClassVar[str] = '{ kind = "point_force", point = [5.3e-3, 2.2e-3], force = [1e3, -2e3], ramp = 3e-6 }'

    point: Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]
    """Where it acts."""
    body: str | None = None
    """Where bodies meet, the one that it acts on."""
    force: Annotated[list[float], Field(min_length=1, max_length=3), Unit("N")]
    """One component for each direction in which the plane moves."""
    ramp: Time = 0.0
    """Time over which the force grows linearly from zero."""
    history: History | None = None
    """Factor of the force in time."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.point", self.point, "xyz" if plane == "solid" else "xy")
        check_vector(f"{key}.force", self.force, components)

    def factor(self, time: float) -> float:
        """What the force is multiplied with."""
        return course(time, self.ramp, self.history)

    def act(self, loads: Loads, key: str) -> Action:
        place = loads.inside(self.point, self.body, key)
        return Action(force=Force.of(place.force(self.force), self.factor))
