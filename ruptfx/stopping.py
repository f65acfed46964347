"""Rules that end a run early, when what follows is of no interest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table, parallel
from ruptfx.places import Position
from ruptfx.schema import CaseError, Part
from ruptfx.units import Duration

if TYPE_CHECKING:
    from ruptfx.fault import Fault
    from ruptfx.model import Model
    from ruptfx.state import State


class StopWhen(Part):
    """End a run before its duration; looked at whenever the interface is saved."""

    sliding_dead_for: Duration | None = None
    """No point slid faster than `output.rupture_threshold` for so long, after sliding had begun."""
    tip_beyond: Position | None = None
    """The rupture has reached a point whose position along an interface is this or more."""
    tip_before: Position | None = None
    """The same to the other side: this or less."""


class StopRules:
    """The rules of a case, looking at the points of this rank.

    Parameters
    ----------
    model : Model

    Attributes
    ----------
    ended : str
        The rule that has ended the run, in words; empty while it goes on.

    Raises
    ------
    CaseError
        A window that no interface reaches: the rule would never act.
    """

    def __init__(self, model: Model) -> None:
        self._model, self._rules = model, model.case.stop_when
        self.ended = ""
        self._slid_at = np.inf  # time at which a point slid last [s]
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
        """All that changes, for a checkpoint."""
        return {"ended": self.ended, "slid_at": self._slid_at}

    def restore(self, table: Table) -> None:
        """Go on from a checkpoint."""
        self.ended, self._slid_at = table["ended"], table["slid_at"]

    def _outside(self, fault: Fault, name: str) -> np.ndarray:
        """Points beyond a limit, shape (points,); none without the rule."""
        limit, position = getattr(self._rules, name), fault.interface.position
        if limit is None:
            return np.zeros(len(position), dtype=bool)
        return position >= limit if name == "tip_beyond" else position <= limit

    def check(self, state: State) -> None:
        """Set `ended` if a rule ends the run now; collective."""
        self.ended = "" if self._rules is None else self._reached(self._rules, state)

    def _reached(self, rules: StopWhen, state: State) -> str:
        """The rule that ends the run now, empty if none does; collective."""
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
