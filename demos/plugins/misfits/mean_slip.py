"""Mean slip at the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from ruptfx.plugin import Final, Floats, Misfit, Request, Sample

if TYPE_CHECKING:
    from ruptfx.plugin import ModelReadings


class MeanSlip(Misfit):
    """Mean slip of the first interface at the end of the run."""

    example: ClassVar[str] = '{ kind = "mean_slip" }'
    unit: ClassVar[str] = "m"

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        return [Final(bodies.model.faults[0].name, "slip")]

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        share = samples[0].weights / samples[0].weights.sum()
        return float(share @ samples[0].values), [share]
