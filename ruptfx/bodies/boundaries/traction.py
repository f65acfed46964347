"""Edges with prescribed traction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from ruptfx.bodies.boundaries import Action, Force, check_vector
from ruptfx.bodies.boundaries._edge_sides import EdgeSides
from ruptfx.bodies.boundaries.histories import History, course
from ruptfx.input.schema import Unit
from ruptfx.input.units import Time
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge


class Traction(EdgeSides):
    """Traction on the edge in addition to the initial load."""

    example: ClassVar[str] = '{ kind = "traction", edge = "upper.top", traction = [1e6, 2e6], ramp = 3e-6 }'

    amounts: ClassVar[tuple[str, ...]] = ("traction", "ramp", "history")

    traction: Annotated[list[float], Field(min_length=1, max_length=3), Unit("Pa")]
    """One component for each direction in which the plane moves; tension is positive, along the outward normal."""
    ramp: Time = 0.0
    """Time over which the traction grows linearly from zero."""
    history: History | None = None
    """Factor of the traction in time."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.traction", self.traction, components)

    def factor(self, time: float) -> float:
        """Return the factor of the traction at a time [s]."""
        return course(time, self.ramp, self.history)

    def act_on(self, edge: Edge, key: str) -> Action:
        if not any(self.traction):  # of which UFL makes no form
            return Action()
        nodal = edge.force(self.traction, self.limits)
        self.refuse_empty(key, edge, nodal)
        return Action(force=Force.of(nodal, self.factor))
