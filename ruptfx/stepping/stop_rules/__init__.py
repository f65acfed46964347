"""Rules that stop a run, one kind per file; the file name is the `kind` of an entry of ``[[stop_when.rules]]``.

A rule is the table of a case, and makes a watch, which is asked at every record of the interface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx import Table
from ruptfx.input.schema import Alternative, alternative

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System


class StopRule(Alternative):
    """Contract of a rule that stops a run."""

    example: ClassVar[str] = ""
    """Entry that ends a run of two plates, 12 mm long: its interface slips at 0.2 MPa between 5 and 7 mm, and stops."""
    reason: ClassVar[str] = ""
    """Text of `ended_by` in the summary of a run that it has stopped."""
    of_interfaces: ClassVar[bool] = True
    """Whether it is without effect in a case without interfaces, which is refused then."""

    def bind(self, model: System, key: str) -> Watch:
        """Return its watch of a run; collective.

        Raises
        ------
        CaseError
            On all ranks, naming the key.
        """
        raise NotImplementedError


class Watch:
    """A rule bound to a model; a class with variables of its own has them in `table` and `restore`."""

    def reached(self, state: State) -> bool:
        """Return whether the run stops now, the same on all ranks; collective."""
        raise NotImplementedError

    def table(self) -> Table:
        """Return its variables, for a checkpoint."""
        return {}

    def restore(self, table: Table) -> None:
        """Restore the variables of a checkpoint."""


if TYPE_CHECKING:
    AnyStopRule = StopRule
else:
    AnyStopRule = alternative("ruptfx.stepping.stop_rules")
