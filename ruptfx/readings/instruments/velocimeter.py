"""Velocity of a point along a direction, alone or relative to another point, as laser velocimeters measure it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import check_vector
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import Plane
from ruptfx.readings.instruments import Channel, Instrument

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings

Point = Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]


class Velocimeter(Instrument):
    """Velocity of a point along a direction; for a pair, relative to the second point.

    A pair on both sides of an interface, close to it, measures the slip rate.
    """

    example: ClassVar[str] = (
        '{ kind = "velocimeter", name = "pair", interval = 2e-7, point = [5e-3, 5e-4], relative_to = [5e-3, -5e-4], '
        "direction = [1.0, 0.0], bandwidth = 2e6 }"
    )

    point: Point
    """Coordinates of the measured point."""
    body: str | None = None
    """Name of the body, required at a point of several bodies."""
    direction: Annotated[list[float], Field(min_length=1, max_length=3), Unit("1")]
    """Measured direction, of any length; one entry for each displacement component."""
    relative_to: Point | None = None
    """Second point of a pair."""
    relative_body: str | None = None
    """Body of the second point."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        axes = "xyz" if plane == "solid" else "xy"
        check_vector(f"{key}.point", self.point, axes)
        check_vector(f"{key}.direction", self.direction, components)
        if self.relative_to is not None:
            check_vector(f"{key}.relative_to", self.relative_to, axes)
        elif self.relative_body is not None:
            raise ValueError(f"{key}.relative_body = '{self.relative_body}': is of the point relative_to; give it")
        if not any(self.direction):
            raise ValueError(f"{key}.direction = {self.direction}: must not be zero")

    @property
    def points(self) -> list[tuple[list[float], str | None]]:
        other = [] if self.relative_to is None else [(self.relative_to, self.relative_body)]
        return [(self.point, self.body), *other]

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        along = np.array(self.direction) / np.linalg.norm(self.direction)
        shares = [readings.point(self.point, self.body, key).motion("velocity", along)]
        text = "velocity along the direction"
        if self.relative_to is not None:
            other = readings.point(self.relative_to, self.relative_body, key, "relative_to")
            shares.append(other.motion("velocity", -along))
            text += " relative to the other point"
        return [Channel("velocity", "m/s", text, shares)]
