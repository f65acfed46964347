"""Collision contact between bodies and fragments that were no neighbours at the start."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.interfaces.collisions.step import FIELD
from ruptfx.interfaces.mechanisms import Mechanism, Rows, Springs
from ruptfx.interfaces.mechanisms._rotation_error import deducting_dissipation
from ruptfx.interfaces.mechanisms.checks.table import Row

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.collisions.step import CollisionStep
    from ruptfx.interfaces.mechanisms.checks.table import Plan
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System


class Collisions(Mechanism):
    """Contact forces between overlapping cells at the surfaces of the bodies."""

    order = 10

    def __init__(self, model: System) -> None:
        super().__init__(model)
        assert model.collisions is not None
        self._step: CollisionStep = model.collisions

    @classmethod
    def present(cls, model: System) -> bool:
        return model.collisions is not None

    def begin(self, state: State) -> None:
        assert self.model.cracks is not None
        state.cracks[FIELD] = np.zeros(len(self.model.cracks.order))
        state.pairs = self._step.initial_state()

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        energies["collisions"] = self._step.stored(state)

    def springs(self) -> list[Springs]:
        return [Springs("the stiffness of collisions", bound=self._step.without_partner())]

    def check(self, plan: Plan) -> Iterator[Row]:
        cells = self.model.mesh.topology.index_map(2).size_global
        note = f"of {cells}, at the start; every facet that fails adds two"
        yield Row("collisions: cells that may meet", self._step.cells(), "", note)

    def saved(self, state: State) -> Mapping[str, Rows]:
        return {"pairs": self._step.gather(state)}

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        state.pairs = {name: read(f"pairs/{name}") for name in state.pairs}  # of all ranks; each looks for its own

    def prepare(self, state: State, kick: Kick) -> None:
        assert self.model.cracks is not None
        # Springs of facets are among the forces whose work the rotation error is about; ties are not.
        with nullcontext() if self.model.cracks.ties_corners else deducting_dissipation(state):
            self._step.find(state)

    def add_first(self, state: State, kick: Kick) -> None:
        self._step(state, kick.clock.since)
