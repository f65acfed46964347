"""Edges that move with a given velocity."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.boundaries import Action, Motion
from ruptfx.boundaries._edge_motion import EdgeMotion
from ruptfx.boundaries._history import ramp
from ruptfx.units import Time, Velocity

if TYPE_CHECKING:
    from ruptfx.edges import Edge


class Driven(EdgeMotion):
    """The edge moves with a given velocity in one direction and is free in the others."""

    example: ClassVar[str] = '{ kind = "driven", edge = "upper.left", component = "x", velocity = 2.0, ramp = 4e-6 }'

    amounts: ClassVar[tuple[str, ...]] = ("velocity", "ramp")

    velocity: Velocity
    """Of the edge, once the ramp is over."""
    ramp: Time = 0.0
    """Time over which the velocity grows linearly from zero."""

    @property
    def largest_speed(self) -> float:
        return abs(self.velocity)

    def speed(self, time: float) -> float:
        """Velocity of the edge [m/s]."""
        return self.velocity * ramp(time, self.ramp)

    def travelled(self, time: float) -> float:
        """Displacement of the edge since time zero [m]."""
        if time < self.ramp:
            return 0.5 * self.velocity * time**2 / self.ramp
        return self.velocity * (time - 0.5 * self.ramp)

    def accelerated(self, time: float) -> float:
        """Acceleration of the edge [m/s2]."""
        return self.velocity / self.ramp if time < self.ramp else 0.0

    def act_on(self, edge: Edge, key: str) -> Action:
        dofs = edge.dofs(self.component, (self.x_range, self.y_range))
        return Action(motion=Motion(dofs, self.travelled, self.speed, self.accelerated))
