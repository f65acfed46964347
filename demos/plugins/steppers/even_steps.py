"""Leapfrog in a given number of steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.plugin import Leapfrog, Stepper

if TYPE_CHECKING:
    from ruptfx.plugin import Motion, System


class EvenSteps(Stepper):
    """Leapfrog in a given number of steps."""

    number: int
    """Number of steps."""

    def bind(self, model: System) -> Motion:
        return Leapfrog(time_step=model.case.duration / self.number).bind(model)
