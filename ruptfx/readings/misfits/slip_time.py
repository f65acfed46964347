"""Time at which a point slips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.units import Coordinate
from ruptfx.readings.misfits import Floats, Misfit, Request, Sample, Trace

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings


class SlipTime(Misfit):
    """Mean time of the slip at a position of an interface, the integral of t V over that of V along the first tangent.

    A smooth measure of the arrival of a rupture, for which the first passage of a slip rate is none.
    """

    example: ClassVar[str] = '{ kind = "slip_time", position = 6e-3 }'
    unit: ClassVar[str] = "s"

    fault: str = "main"
    """Name of the interface."""
    position: Coordinate
    """Position along the interface."""

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        channels = bodies.at_fault(self.fault, self.position, key)
        rate = next(channel for channel in channels if channel.name.startswith("slip_rate"))
        return [Trace(replace(rate, name=f"slip rate at {self.position:g} m"), None)]

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        (sample,) = samples
        weights = np.gradient(sample.at)
        slip = float(weights @ sample.values)
        if slip == 0:
            raise RuptfxError(
                f"objective: slip_time at position = {self.position:g} m: this point does not slip in the run; choose "
                "another position, or make the run longer"
            )
        mean = float((weights * sample.at) @ sample.values) / slip
        return mean, [weights * (sample.at - mean) / slip]
