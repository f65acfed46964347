"""Time steppers, one per file; the file name is the `kind` in a case.

A stepper never writes files and does not know how long the run is; `ruptfx.simulation` asks it for one step after
another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from ruptfx.contact import Way
from ruptfx.schema import Alternative, alternative


class Motion(Protocol):
    """A stepper bound to a model."""

    dt: float
    """Size of the steps [s]; of the first where they vary. What must survive a restart, like the size of the next
    one, is kept in `State.numbers` and `State.fields`."""

    collective: bool
    """Whether every step exchanges messages with all ranks anyway: then signals and errors are looked for in each."""

    def step(self, state: Any) -> None:
        """Advance the state in place by one step, its time and number included."""

    def energies(self, state: Any) -> dict[str, float]:
        """Energy budget over all ranks [J] at the time where the scheme balances it; collective."""


class Stepper(Alternative):
    """The contract of a time stepper."""

    ways: ClassVar[tuple[Way, ...]] = ("explicit",)
    """How it asks interfaces for their traction: from what is known at the time (explicit), or with the displacement it
    is solved with (implicit). The contact method must be able to do all of them."""
    second_order: ClassVar[bool] = True
    """Whether its error falls with the square of the step, with all options as they are; False where they decide."""
    conserving: ClassVar[dict[str, Any] | None] = None
    """Fields with which the energy budget closes to round-off; None if it does not."""
    inertia: ClassVar[bool] = True
    """Whether it solves the equation of motion, or only equilibrium."""
    adaptive: ClassVar[bool] = False
    """Whether its steps vary."""

    def bind(self, model: Any) -> Motion:
        """Choose the step and prepare the arrays.

        Raises
        ------
        CaseError
            A time step the model does not allow.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyStepper = Stepper
else:
    AnyStepper = alternative("ruptfx.steppers")
