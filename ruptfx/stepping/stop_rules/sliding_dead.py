"""Sliding that has died."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx import Table
from ruptfx.input.units import Duration
from ruptfx.platform import parallel
from ruptfx.stepping.stop_rules import StopRule, Watch

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System


class SlidingDead(StopRule):
    """No sliding for some time, after the first; `stop_when.sliding_dead_for` in short."""

    example: ClassVar[str] = '{ kind = "sliding_dead", duration = 3e-6 }'
    reason: ClassVar[str] = "sliding died"

    duration: Duration
    """Duration without slip faster than `output.rupture_threshold`."""

    def bind(self, model: System, key: str) -> SlidingWatch:
        return SlidingWatch(model, self.duration)


class SlidingWatch(Watch):
    """Time of the last sliding."""

    def __init__(self, model: System, duration: float) -> None:
        self.model, self.duration = model, duration
        self.slid_at = np.inf  # [s]

    def table(self) -> Table:
        return {"slid_at": self.slid_at}

    def restore(self, table: Table) -> None:
        self.slid_at = table["slid_at"]

    def reached(self, state: State) -> bool:
        threshold = self.model.case.output.rupture_threshold
        sliding, ruptured = 0, 0
        for fault in self.model.faults:
            fields = state.faults[fault.name]
            sliding += int((np.linalg.norm(fault.components(fields, "slip_rate"), axis=-1) > threshold).sum())
            ruptured += int(np.isfinite(fields["rupture_time"]).sum())
        sliding, ruptured = parallel.total(self.model.comm, [sliding, ruptured]).astype(int)
        if sliding or not ruptured:
            self.slid_at = state.time
        self.slid_at = min(self.slid_at, state.time)
        return state.time - self.slid_at >= self.duration
