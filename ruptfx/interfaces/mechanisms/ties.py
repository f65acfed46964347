"""Nodes of two edges that are tied to each other and move alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.interfaces.mechanisms import Mechanism

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System


class Ties(Mechanism):
    """Tied nodes have the sum of both forces and the velocity of the first."""

    order = 80
    local_steps = True

    @classmethod
    def present(cls, model: System) -> bool:
        return bool(model.bodies.ties)

    def nodes(self) -> NDArray[np.bool_]:
        result = super().nodes()
        result[self.model.layout.kept] = result[self.model.layout.copies] = True
        return result

    def combine(self, state: State, kick: Kick) -> None:
        self.model.layout.sum_tied(state.force)

    def after_kick(self, state: State, kick: Kick) -> None:
        # An interface that ends at a tie has changed the velocity of one of the two nodes only.
        self.model.layout.equalise(state.velocity)
