"""What acts at a point of the bodies."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ruptfx.boundaries import Boundary
from ruptfx.boundaries._history import History, course
from ruptfx.schema import Unit
from ruptfx.units import Time


class AtPoint(Boundary):
    """Place and course in time of a source."""

    point: Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]
    """Where it acts."""
    body: str | None = None
    """Where bodies meet, the one that it acts on."""
    ramp: Time = 0.0
    """Time over which it grows linearly from zero."""
    history: History | None = None
    """Its factor in time."""

    def factor(self, time: float) -> float:
        """What it is multiplied with."""
        return course(time, self.ramp, self.history)
