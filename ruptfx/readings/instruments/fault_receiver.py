"""Slip and tractions at a point of an interface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from ruptfx.bodies.boundaries import check_vector
from ruptfx.input.schema import Unit
from ruptfx.input.units import Coordinate
from ruptfx.laws.materials import Plane
from ruptfx.readings.instruments import Channel
from ruptfx.readings.instruments._stations import AtStations

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings


class FaultReceiver(AtStations):
    """Slip, slip rate, tractions, opening and the state of the law at a position of an interface.

    In 2D at a position, linear between the two points next to it; in 3D at a point, by the shape functions of the
    elements there, and along both tangents: the first is horizontal, the second points down dip; on a horizontal
    interface they are x and normal x first.
    """

    example: ClassVar[str] = '{ kind = "fault_receiver", name = "fault", interval = 2e-7, position = 5.3e-3 }'

    fault: str = "main"
    """Name of the interface."""
    position: Coordinate | None = None
    """Position along the interface, in 2D."""
    point: Annotated[list[float], Field(min_length=3, max_length=3), Unit("m")] | None = None
    """Point on the interface, in 3D."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        if plane == "solid":
            if self.position is not None or self.point is None:
                text = "is not given" if self.position is None else f"and position = {self.position:g}"
                raise ValueError(f"{key}.point {text}: in 3D give the point of the interface, [x, y, z], alone")
            check_vector(f"{key}.point", self.point, "xyz")
        elif self.point is not None or self.position is None:
            text = "is not given" if self.point is None else f"and point = {self.point}"
            raise ValueError(f"{key}.position {text}: in 2D give the position along the interface, alone")

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        place = self.point if self.position is None else self.position
        assert place is not None
        return readings.at_fault(self.fault, place, key)
