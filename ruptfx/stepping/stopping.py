"""Rules that stop a run early."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx import Table
from ruptfx.input.profiles.places import Position
from ruptfx.input.schema import Part
from ruptfx.input.units import Duration
from ruptfx.stepping.stop_rules import AnyStopRule, StopRule
from ruptfx.stepping.stop_rules.sliding_dead import SlidingDead
from ruptfx.stepping.stop_rules.tip_before import TipBefore
from ruptfx.stepping.stop_rules.tip_beyond import TipBeyond

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System


class StopWhen(Part):
    """Rules that stop a run before its duration; evaluated at every record of the interface."""

    sliding_dead_for: Duration | None = None
    """Duration without slip faster than `output.rupture_threshold`, after the first sliding."""
    tip_beyond: Position | None = None
    """Position along an interface; the run stops when the rupture reaches it or a larger one."""
    tip_before: Position | None = None
    """Position along an interface; the run stops when the rupture reaches it or a smaller one."""
    rules: list[AnyStopRule] = []
    """Further rules, an entry each."""

    def by_key(self) -> dict[str, StopRule]:
        """Return all rules by their keys in the case, in the order in which they are asked."""
        rules: dict[str, StopRule] = {}
        if self.tip_beyond is not None:
            rules[f"stop_when.tip_beyond = {self.tip_beyond:g}"] = TipBeyond(position=self.tip_beyond)
        if self.tip_before is not None:
            rules[f"stop_when.tip_before = {self.tip_before:g}"] = TipBefore(position=self.tip_before)
        if self.sliding_dead_for is not None:
            rules[f"stop_when.sliding_dead_for = {self.sliding_dead_for:g}"] = SlidingDead(
                duration=self.sliding_dead_for
            )
        return rules | {f"stop_when.rules.{number}": rule for number, rule in enumerate(self.rules)}


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
        entries = {} if rules is None else rules.by_key()
        self._watches = [(rule.reason or rule.kind(), rule.bind(model, key)) for key, rule in entries.items()]
        self.ended = ""

    def table(self) -> Table:
        """Return all variables, for a checkpoint."""
        return {"ended": self.ended, "watches": [watch.table() for _, watch in self._watches]}

    def restore(self, table: Table) -> None:
        """Restore the variables of a checkpoint."""
        self.ended = table["ended"]
        for (_, watch), variables in zip(self._watches, table["watches"], strict=True):
            watch.restore(variables)

    def check(self, state: State) -> None:
        """Set `ended` if a rule stops the run now; collective."""
        reached = [reason for reason, watch in self._watches if watch.reached(state)]  # every watch sees every record
        self.ended = reached[0] if reached else ""
