"""Rotation of a point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from ruptfx.plugin import Channel, Instrument, Unit

if TYPE_CHECKING:
    from ruptfx.plugin import ModelReadings


class Tiltmeter(Instrument):
    """Rotation of a point in the plane."""

    example: ClassVar[str] = '{ kind = "tiltmeter", name = "tilt", interval = 2e-7, point = [5.3e-3, 2.2e-3] }'
    point: Annotated[list[float], Unit("m")]
    """Coordinates of the point."""

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        turn = np.array([[0, 0], [0, 0.5], [-0.5, 0]])  # (du_y/dx - du_x/dy) / 2
        return [Channel("rotation", "rad", "rotation", [readings.point(self.point, None, key).reading(turn)])]
