"""Mean slip at the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from ruptfx.plugin import Final, Floats, Misfit, Request, RuptfxError, Sample

if TYPE_CHECKING:
    from ruptfx.plugin import ModelReadings


class MeanSlip(Misfit):
    """Mean slip of an interface at the end of the run."""

    example: ClassVar[str] = '{ kind = "mean_slip" }'
    unit: ClassVar[str] = "m"

    fault: str | None = None
    """Name of the interface; needed where the case has several."""

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        names = [fault.name for fault in bodies.model.faults]
        if self.fault is None and len(names) == 1:
            return [Final(names[0], "slip")]
        if self.fault is None or self.fault not in names:
            raise RuptfxError(f"{key}.fault = {self.fault}: give the name of an interface, one of {', '.join(names)}")
        return [Final(self.fault, "slip")]

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        share = samples[0].weights / samples[0].weights.sum()
        return float(share @ samples[0].values), [share]
