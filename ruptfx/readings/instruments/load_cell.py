"""The force on an edge."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.readings.instruments import Channel, Instrument

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings


class LoadCell(Instrument):
    """External force on an edge, in 2D per unit thickness, including the initial stress.

    It is the force on the nodes of the edge, K u + M a, so that force times velocity of a driven edge is the work in
    `energy.csv`. Materials with memory add the force of their inelastic stress, which takes a further sweep over their
    elements in every step. Nodes at the ends of the edge are included as a whole, with the forces of other edges and
    interfaces. Implicit steps have the acceleration half-way between two steps only: the last sample of a run may be
    missing.
    """

    example: ClassVar[str] = '{ kind = "load_cell", name = "cell", interval = 2e-7, edge = "upper.right" }'

    edge: str
    """``body.side``, for example ``upper.left``."""

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        return [
            Channel(f"force_{label}", readings.force_unit, f"force on the edge along {label}", shares, offset)
            for label, shares, offset in readings.forces(self.edge, f"{key}.edge")
        ]
