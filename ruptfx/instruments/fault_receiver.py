"""Slip and tractions at a point of an interface."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.instruments import Channel, Instrument
from ruptfx.units import Coordinate

if TYPE_CHECKING:
    from ruptfx.sensed import Sensed


class FaultReceiver(Instrument):
    """Slip, slip rate, tractions, opening and the state of the law at a position along an interface in 2D.

    Linear between the two points next to it.
    """

    example: ClassVar[str] = '{ kind = "fault_receiver", name = "fault", interval = 2e-7, position = 5.3e-3 }'

    fault: str = "main"
    """Which interface."""
    position: Coordinate
    """Along it."""

    def channels(self, plates: Sensed, key: str) -> list[Channel]:
        return plates.at_fault(self.fault, self.position, key)
