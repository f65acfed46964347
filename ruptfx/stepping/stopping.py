"""Rules that stop a run early."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.input.profiles.places import Position
from ruptfx.input.schema import CaseError, Part
from ruptfx.input.units import Duration
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System


class StopWhen(Part):
    """Rules that stop a run before its duration; evaluated at every record of the interface."""

    sliding_dead_for: Duration | None = None
    """Duration without slip faster than `output.rupture_threshold`, after the first sliding."""
    tip_beyond: Position | None = None
    """Position along an interface; the run stops when the rupture reaches it or a larger one."""
    tip_before: Position | None = None
    """Position along an interface; the run stops when the rupture reaches it or a smaller one."""


class StopRules:
    """Rules of a case, evaluated at the points of this rank.

    Parameters
    ----------
    model : System
    rules : StopWhen, optional
        None stops nothing.

    Attributes
    ----------
    ended : str
        Text of the rule that has stopped the run; empty before.

    Raises
    ------
    CaseError
        If no interface reaches the position of a rule.
    """

    def __init__(self, model: System, rules: StopWhen | None) -> None:
        self._model, self._rules = model, rules
        self.ended = ""
        self._slid_at = np.inf  # time of the last sliding [s]
        if self._rules is None:
            return
        for name in ("tip_beyond", "tip_before"):
            limit = getattr(self._rules, name)
            points = sum(self._outside(fault, name).sum() for fault in model.faults)
            if limit is not None and parallel.total(model.comm, points) == 0:
                shared = [parallel.share_rows(model.comm, fault.interface.position) for fault in model.faults]
                known = [
                    f"faults.{fault.name} from {x.min():.6g} to {x.max():.6g} m"
                    for fault, x in zip(model.faults, shared, strict=True)
                ]
                raise CaseError(
                    f"stop_when.{name} = {limit:g}: no interface reaches that position; there are: "
                    f"{', '.join(known) or 'none'}"
                )

    def table(self) -> Table:
        """Return all variables, for a checkpoint."""
        return {"ended": self.ended, "slid_at": self._slid_at}

    def restore(self, table: Table) -> None:
        """Restore the variables of a checkpoint."""
        self.ended, self._slid_at = table["ended"], table["slid_at"]

    def _outside(self, fault: Fault, name: str) -> np.ndarray:
        """Return points beyond a limit, shape (points,); none without the rule."""
        limit, position = getattr(self._rules, name), fault.interface.position
        if limit is None:
            return np.zeros(len(position), dtype=bool)
        return position >= limit if name == "tip_beyond" else position <= limit

    def check(self, state: State) -> None:
        """Set `ended` if a rule stops the run now; collective."""
        self.ended = "" if self._rules is None else self._reached(self._rules, state)

    def _reached(self, rules: StopWhen, state: State) -> str:
        """Return the rule that stops the run now, empty if there is none; collective."""
        threshold = self._model.case.output.rupture_threshold
        sliding, ruptured, left = 0, 0, 0
        for fault in self._model.faults:
            fields = state.faults[fault.name]
            arrived = np.isfinite(fields["rupture_time"])
            sliding += int((np.linalg.norm(fault.components(fields, "slip_rate"), axis=-1) > threshold).sum())
            ruptured += int(arrived.sum())
            left += int((arrived & (self._outside(fault, "tip_beyond") | self._outside(fault, "tip_before"))).sum())
        sliding, ruptured, left = parallel.total(self._model.comm, [sliding, ruptured, left]).astype(int)
        if left:
            return "tip left the window"
        if sliding or not ruptured:
            self._slid_at = state.time
        dead = rules.sliding_dead_for
        self._slid_at = min(self._slid_at, state.time)
        return "sliding died" if dead is not None and state.time - self._slid_at >= dead else ""
