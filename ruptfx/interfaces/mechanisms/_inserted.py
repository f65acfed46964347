"""Forces of elements that the bulk kernel computes in the sweep of its steps, beside those of the elastic stress."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.operators import nodes_of_sweeps
from ruptfx.interfaces.mechanisms import Floats, Mechanism

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System


class InsertedForce(Mechanism):
    """Base of mechanisms with an inelastic stress.

    If `inelastic` is set, the bulk kernel computes its force block by block and advances nodes with it; this class adds
    it at the stepped nodes. A subclass without `inelastic` adds `_force` to that of the state itself.
    """

    def __init__(self, model: System) -> None:
        super().__init__(model)
        self._force: Floats = np.zeros(0)

    def bind(self, stepped: SteppedNodes) -> None:
        model = self.model
        self._stepped, self._force = stepped, np.zeros(len(model.mass))
        self._dofs = stepped.dofs
        if self.inelastic is not None:
            self.inelastic.force = self._force
            nodes = nodes_of_sweeps(model.space, self.inelastic.sweeps)
            self._dofs = stepped.dofs[nodes[stepped.dofs // model.components]]
        self._index = stepped.index if len(self._dofs) == len(stepped.dofs) else self._dofs
        shared = model.layout.shared[self._dofs // model.components]
        self._shared, self._others = self._dofs[shared], self._dofs[~shared]

    def add_with_elements(self, state: State, kick: Kick) -> None:
        if self.inelastic is not None:
            self._stepped.add_damping(self._shared, 1.0, self._force, state.force)

    def add_internal(self, state: State, kick: Kick) -> None:
        if self.inelastic is not None:
            self._stepped.add_damping(self._others, 1.0, self._force, state.force)

    def outside_energy(self) -> list[tuple[NDArray[np.int64] | slice, Floats]]:
        return [] if self.inelastic is None else [(self._index, self._force[self._index].copy())]
