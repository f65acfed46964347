"""Sources at a point of the bodies."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ruptfx.bodies.boundaries import Boundary
from ruptfx.bodies.boundaries.histories import History, course
from ruptfx.input.schema import Unit
from ruptfx.input.units import Time


class AtPoint(Boundary):
    """Place and time history of a point source."""

    point: Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]
    """Coordinates of the point."""
    body: str | None = None
    """Body that the source acts on, needed where several bodies share the point."""
    ramp: Time = 0.0
    """Time over which the source grows linearly from zero."""
    history: History | None = None
    """Factor of the source in time."""

    def factor(self, time: float) -> float:
        """Return the factor of the source at a time [s]."""
        return course(time, self.ramp, self.history)
