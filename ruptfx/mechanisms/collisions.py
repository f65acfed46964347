"""Contact between pieces of bodies that were no neighbours."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.mechanisms import Mechanism
from ruptfx.mechanisms._turning import deducting_dissipation

if TYPE_CHECKING:
    from ruptfx.collisions._step import CollisionStep
    from ruptfx.mechanisms._nodes import Kick
    from ruptfx.model import Model
    from ruptfx.state import State


class Collisions(Mechanism):
    """Forces between overlapping cells at the surfaces of the bodies."""

    order = 10

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        assert model.collisions is not None
        self._step: CollisionStep = model.collisions

    @classmethod
    def present(cls, model: Model) -> bool:
        return model.collisions is not None

    def prepare(self, state: State, kick: Kick) -> None:
        with deducting_dissipation(state):
            self._step.find(state)

    def add_first(self, state: State, kick: Kick) -> None:
        self._step(state, kick.clock.since)
