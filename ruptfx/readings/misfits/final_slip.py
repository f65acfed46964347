"""Slip at the end against a given one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.fields import component_names
from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError, nearest
from ruptfx.input.units import Length, VaryingGap
from ruptfx.readings.misfits import Final, Floats, Misfit, Request, Sample

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings


class FinalSlip(Misfit):
    """Slip at the end of the run: half the mean of ((slip - target) / sigma)^2 over the interface.

    Slip is that along the first tangent.
    """

    example: ClassVar[str] = '{ kind = "final_slip", target = 1e-6, sigma = 1e-6 }'

    fault: str = "main"
    """Name of the interface."""
    target: VaryingGap = 0.0
    """Slip that is wanted [m]: a number, or a profile such as a `table` with a file."""
    sigma: Length
    """Standard deviation of the slip."""

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        known = {fault.name: fault for fault in bodies.model.faults}
        if self.fault not in known:
            raise CaseError(f"{key}.fault = '{self.fault}': no such interface, {nearest(self.fault, list(known))}")
        return [Final(self.fault, component_names("slip", known[self.fault].tangents)[0])]

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        (sample,) = samples
        share = sample.weights / sample.weights.sum()
        residual = (sample.values - evaluate(self.target, sample.at)) / self.sigma
        return 0.5 * float(share @ np.square(residual)), [share * residual / self.sigma]

    def residuals(self, samples: Sequence[Sample]) -> list[tuple[Floats, Floats]]:
        (sample,) = samples
        factor = np.sqrt(sample.weights / sample.weights.sum()) / self.sigma
        return [(factor * (sample.values - evaluate(self.target, sample.at)), factor)]
