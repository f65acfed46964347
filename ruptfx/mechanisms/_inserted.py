"""Forces of elements that the bulk kernel computes in the sweep of its steps, beside those of the elastic stress."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.mechanisms import Floats, Mechanism

if TYPE_CHECKING:
    from ruptfx.mechanisms._nodes import Kick, SteppedNodes
    from ruptfx.mechanisms._system import System
    from ruptfx.state import State


class InsertedForce(Mechanism):
    """Base of mechanisms with an inelastic stress.

    If `inelastic` is set, the bulk kernel computes its force block by block and advances nodes with it; this class adds
    it at the stepped nodes. A subclass without `inelastic` adds `_force` to that of the state itself.
    """

    def __init__(self, model: System) -> None:
        super().__init__(model)
        self._force: Floats = np.zeros(len(model.mass))

    def bind(self, stepped: SteppedNodes) -> None:
        model = self.model
        here = np.full(model.nodes, self.inelastic is None)
        for sweep in () if self.inelastic is None else self.inelastic.sweeps:
            here[model.space.dofmap.list[sweep.batches]] = True
        self._dofs = stepped.dofs[here[stepped.dofs // model.components]]
        self._index = stepped.index if len(self._dofs) == len(stepped.dofs) else self._dofs
        shared = model.layout.shared[self._dofs // model.components]
        self._shared, self._others = self._dofs[shared], self._dofs[~shared]

    def add_first(self, state: State, kick: Kick) -> None:
        self._before = state.velocity[self._index].copy()

    def add_with_elements(self, state: State, kick: Kick) -> None:
        if self.inelastic is not None:
            state.force[self._shared] += self._force[self._shared]

    def add_internal(self, state: State, kick: Kick) -> None:
        if self.inelastic is not None:
            state.force[self._others] += self._force[self._others]

    def outside_energy(self) -> list[tuple[NDArray[np.int64] | slice, Floats]]:
        return [] if self.inelastic is None else [(self._index, self._force[self._index].copy())]

    def powers(self, state: State) -> tuple[float, float]:
        """Return the power of the force with the velocities before and after the step [W], and clear the force."""
        force = self._force[self._index]
        before, after = float(force @ self._before), float(force @ state.velocity[self._index])
        if self.inelastic is not None:
            before, after = before + self.inelastic.power[0], after + self.inelastic.power[1]
            self.inelastic.power[:] = 0
            self._force[self._index] = 0
        return before, after
