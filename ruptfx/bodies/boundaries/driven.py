"""Edges that move with a prescribed velocity."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.bodies.boundaries import Action, PrescribedMotion
from ruptfx.bodies.boundaries._edge_motion import EdgeMotion
from ruptfx.bodies.boundaries.histories import ramp
from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Time, VaryingFactor, Velocity
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge


class Driven(EdgeMotion):
    """Edge with a prescribed velocity in one direction, free in the others."""

    example: ClassVar[str] = '{ kind = "driven", edge = "upper.left", component = "x", velocity = 2.0, ramp = 4e-6 }'

    amounts: ClassVar[tuple[str, ...]] = ("velocity", "profile", "ramp")

    velocity: Velocity
    """Velocity of the edge after the ramp."""
    profile: VaryingFactor = 1.0
    """Factor of the velocity along the edge, as a function of x, or of y where the edge is higher than long."""
    ramp: Time = 0.0
    """Time over which the velocity grows linearly from zero."""

    @property
    def largest_speed(self) -> float:
        return abs(self.velocity)

    def speed(self, time: float) -> float:
        """Return the velocity of the edge at a time [m/s]."""
        return self.velocity * ramp(time, self.ramp)

    def travelled(self, time: float) -> float:
        """Return the displacement of the edge since time zero [m]."""
        if time < self.ramp:
            return 0.5 * self.velocity * time**2 / self.ramp
        return self.velocity * (time - 0.5 * self.ramp)

    def accelerated(self, time: float) -> float:
        """Return the acceleration of the edge at a time [m/s2]."""
        return self.velocity / self.ramp if time < self.ramp else 0.0

    def act_on(self, edge: Edge, key: str) -> Action:
        dofs = edge.dofs(self.component, (self.x_range, self.y_range))
        if not callable(self.profile) and self.profile == 1:
            return Action(motion=PrescribedMotion(dofs, self.travelled, self.speed, self.accelerated))
        factor, error = np.ones(len(dofs)), None
        along = edge.along()[dofs // edge.model.components]
        try:
            factor = evaluate(self.profile, along)
        except CaseError as caught:
            error = CaseError(f"{key}.profile: {caught}")
        parallel.raise_on_all(edge.model.comm, error)

        def scaled(course: Callable[[float], float]) -> Callable[[float], np.ndarray]:
            return lambda time: factor * course(time)

        courses = scaled(self.travelled), scaled(self.speed), scaled(self.accelerated)
        return Action(motion=PrescribedMotion(dofs, *courses))
