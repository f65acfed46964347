"""Time steppers, one per file; the file name is the `kind` in a case.

A stepper never writes files and does not know how long the run is; `ruptfx.simulation` asks it for one step after
another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

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
