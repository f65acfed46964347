"""Rules on the position of a rupture tip."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.profiles.places import Position
from ruptfx.input.schema import CaseError
from ruptfx.platform import parallel
from ruptfx.stepping.stop_rules import StopRule, Watch

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System


class Tip(StopRule):
    """A rupture that reaches positions on one side of a limit."""

    reason: ClassVar[str] = "tip left the window"
    sign: ClassVar[int] = 1
    """1 where the run stops at the limit and larger positions, -1 at smaller ones."""

    position: Position
    """Position along an interface, in its own measure."""

    def bind(self, model: System, key: str) -> TipWatch:
        return TipWatch(model, self, key)


class TipWatch(Watch):
    """Points on one side of the limit, of which the first that ruptures stops the run."""

    def __init__(self, model: System, rule: Tip, key: str) -> None:
        self.model = model
        limit = rule.position
        self.outside = {
            fault.name: rule.sign * (fault.interface.position - limit) >= 0 for fault in model.faults
        }  # fmt: skip
        if parallel.total(model.comm, sum(int(points.sum()) for points in self.outside.values())) == 0:
            positions = [parallel.share_rows(model.comm, fault.interface.position) for fault in model.faults]
            known = [
                f"faults.{fault.name} from {x.min():.6g} to {x.max():.6g} m"
                for fault, x in zip(model.faults, positions, strict=True)
            ]
            raise CaseError(
                f"{key}: no interface reaches the position {limit:g}; there are: {', '.join(known) or 'none'}"
            )

    def reached(self, state: State) -> bool:
        arrived = [
            np.count_nonzero(np.isfinite(state.faults[name]["rupture_time"]) & points)
            for name, points in self.outside.items()
        ]
        return bool(parallel.total(self.model.comm, sum(arrived)))
