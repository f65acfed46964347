"""The force on an edge."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.instruments import Channel, Instrument

if TYPE_CHECKING:
    from ruptfx.sensed import Sensed


class LoadCell(Instrument):
    """Force on an edge, from outside, per length of thickness in 2D; with that of the initial stress.

    It is what the nodes of the edge need beyond the forces of their elements, K u + M a, so that force times velocity
    of a driven edge is the work that `energy.csv` has. Nodes at the ends of the edge belong to it as a whole, with what
    other edges and interfaces exert on them. Implicit steps know the acceleration half-way between two steps only: the
    last sample of a run may be missing.
    """

    example: ClassVar[str] = '{ kind = "load_cell", name = "cell", interval = 2e-7, edge = "upper.right" }'

    edge: str
    """``body.side``, for example ``upper.left``."""

    def channels(self, plates: Sensed, key: str) -> list[Channel]:
        return [
            Channel(f"force_{label}", plates.force_unit, f"force on the edge along {label}", shares, offset)
            for label, shares, offset in plates.forces(self.edge, f"{key}.edge")
        ]
