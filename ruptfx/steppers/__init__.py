"""Time steppers, one per file; the file name is the `kind` in a case.

A stepper never writes files and does not know how long the run is; `ruptfx.simulation` asks it for one step after
another.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from ruptfx.schema import Alternative, alternative


class Motion(Protocol):
    """A stepper bound to a model."""

    dt: float
    """Size of the (next) step [s]."""

    def step(self, state: Any) -> None:
        """Advance the state in place by one step."""


class Stepper(Alternative):
    """The contract of a time stepper."""

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
