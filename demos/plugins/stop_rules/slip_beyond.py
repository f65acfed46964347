"""Slip that reaches a limit."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.plugin import Length, StopRule, Watch, largest

if TYPE_CHECKING:
    from ruptfx.plugin import State, System


class SlipBeyond(StopRule):
    """Slip that reaches a limit somewhere along the interfaces."""

    example: ClassVar[str] = '{ kind = "slip_beyond", slip = 1e-8 }'
    reason: ClassVar[str] = "slip reached its limit"
    slip: Length
    """Slip at which the run stops."""

    def bind(self, model: System, key: str) -> SlipWatch:
        return SlipWatch(model, self.slip)


class SlipWatch(Watch):
    """The largest slip of all points."""

    def __init__(self, model: System, limit: float) -> None:
        self.model, self.limit = model, limit

    def reached(self, state: State) -> bool:
        slips = [fault.components(state.faults[fault.name], "slip") for fault in self.model.faults]
        here = max((np.linalg.norm(slip, axis=-1).max(initial=0.0) for slip in slips), default=0.0)
        return largest(self.model.comm, float(here)) >= self.limit
