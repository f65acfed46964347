"""Large rotations of bodies: the work of forces whose energy is not a quadratic form."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.input.fields import OF_BODIES, OF_COLLISIONS, OF_VISCOSITY
from ruptfx.interfaces.mechanisms import Mechanism

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System


class LargeRotations(Mechanism):
    """Account for the work of the forces of cells, facets and supports.

    Leapfrog balances the work that the mean of successive forces does. An energy that is not a quadratic form changes
    by something else in a finite step, of second order in it; `Model.energies` has the difference as `rotation_error`.
    """

    order = 40

    @classmethod
    def present(cls, model: System) -> bool:
        return model.bulk.large_rotations

    @property
    def _has_springs(self) -> bool:
        """Return whether facets exert forces as cells do; others change velocities, and balance their work."""
        return self.model.cracks is not None and not self.model.cracks.ties_corners

    def close_energies(self, state: State, energies: dict[str, float]) -> None:
        # By how much the work of the forces of cells, facets and supports exceeds what these store.
        stored = energies["strain"]
        if self._has_springs:
            assert self.model.cracks is not None
            stored += self.model.cracks.stored(state.cracks, 0.5 * state.lag * state.velocity, state.at_faults()[1])
        force = state.fields.get(OF_BODIES)
        over = 0.0 if force is None else self.model.layout.owned_dot(force, state.velocity)
        energies["rotation_error"] = state.energy["rotation_error"] - stored - 0.5 * state.lag * over

    def nodes(self) -> NDArray[np.bool_]:
        return ~super().nodes()  # the forces of all nodes are needed

    def add_internal(self, state: State, kick: Kick) -> None:
        force, model = state.force.copy(), self.model
        for name in (OF_COLLISIONS, OF_VISCOSITY):
            if name in state.fields:
                force -= state.fields[name]
        if OF_BODIES in state.fields:
            mean = 0.5 * (state.fields[OF_BODIES] + force)
            state.energy["rotation_error"] -= kick.clock.since * model.layout.owned_dot(mean, state.velocity)
        else:
            state.energy["rotation_error"] += model.strain_energy(state.displacement)
            if self._has_springs:
                assert model.cracks is not None
                state.energy["rotation_error"] += model.cracks.stored(state.cracks, 0 * force, state.displacement)
        state.fields[OF_BODIES] = force
