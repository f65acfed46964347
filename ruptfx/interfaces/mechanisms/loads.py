"""Boundaries in explicit steps: elastic supports, applied forces, prescribed motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.interfaces.mechanisms import Floats, Mechanism

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System


class Supports(Mechanism):
    """Elastic supports of edges, whose energy is part of the strain energy."""

    order = 30
    adjoint = local_steps = True

    @classmethod
    def present(cls, model: System) -> bool:
        return bool(model.loads.supports)

    def add_internal(self, state: State, kick: Kick) -> None:
        self.model.loads.add_support_force(state.displacement, state.force)


class Loads(Mechanism):
    """Applied forces and prescribed motion; dashpots are in the update of the stepped nodes."""

    order = 50
    adjoint = local_steps = True

    def __init__(self, model: System) -> None:
        super().__init__(model)
        self._forces = [*model.loads.forces, *model.loads.ended]
        self._factors: list[float | Floats] = []
        self._shares: list[tuple[NDArray[np.int64], Floats]] = []

    def nodes(self) -> NDArray[np.bool_]:
        return np.asarray(self.model.loads.acting.reshape(-1, self.model.components).any(axis=1))

    def smooth_nodes(self) -> NDArray[np.bool_]:
        # Dashpots and loads are linear in the velocity: impulses of elements act between them.
        return np.zeros(self.model.nodes, dtype=bool)

    def bind(self, stepped: SteppedNodes) -> None:
        # For every load the places of its degrees of freedom, and its forces at those that this rank counts.
        self._stepped = stepped
        self._shares = [
            (places, load.values * stepped.owned[places])
            for load, places in ((load, stepped.among(load.dofs)) for load in self._forces)
        ]

    def add_external(self, state: State, kick: Kick) -> None:
        self._factors = self.model.loads.mean_factors(state.time, kick.clock.since)
        for load, factor in zip(self._forces, self._factors, strict=True):
            state.force[load.dofs] += factor * load.values

    def after_kick(self, state: State, kick: Kick) -> None:
        self.model.loads.drive(state.velocity, state.time + 0.5 * kick.clock.dt)

    def account(self, state: State, kick: Kick) -> None:
        stepped = self._stepped
        for (places, share), factor in zip(self._shares, self._factors, strict=True):
            mean = 0.5 * (stepped.velocity_before[places] + state.velocity[stepped.dofs[places]])
            state.energy["boundary_work"] += float((share * factor) @ mean) * kick.clock.kick
