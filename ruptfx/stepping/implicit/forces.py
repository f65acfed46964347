"""Forces of bodies, interfaces and boundaries in implicit steps, and their work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.state import State
from ruptfx.interfaces.mechanisms import responding
from ruptfx.stepping.implicit.solution import Solution

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System


class Forces:
    """Forces of a model at a time or in a state.

    Attributes
    ----------
    dashpot : ndarray, shape (nodes * components,)
        Force per velocity of boundaries and mass damping [N s/m].
    """

    def __init__(self, model: System) -> None:
        self.model = model
        self.dashpot = model.loads.dashpot + model.case.damping.mass * model.mass
        self._driven = model.loads.prescribed
        self._mechanisms = responding(model.mechanisms)

    def load(self, time: float) -> np.ndarray:
        """Return F, the nodal force of the boundaries [N]."""
        return self.model.loads.force(time)

    def damping_force(self, velocity: np.ndarray) -> np.ndarray:
        """Return C v + eta K_v v [N]: dashpots, mass damping and the Kelvin-Voigt layer."""
        force: np.ndarray = self.dashpot * velocity
        viscosity = self.model.viscosity
        if viscosity is not None:
            layer = np.zeros_like(force)
            viscosity.operator.add_internal_force(velocity, layer)
            self.model.layout.sum_shared(layer)
            force -= viscosity.eta * layer
        return force

    def internal(self, state: State) -> np.ndarray:
        """Return K u + J' W (T - T_0) [N] of a state, with its tractions and the forces of other mechanisms."""
        force: np.ndarray = -self.model.internal_force(state.displacement)
        for each in self._mechanisms:
            reaction = each.force_of(state)
            force.reshape(self.model.nodes, -1)[reaction.nodes] -= reaction.force
        tractions = self.tractions(state)
        for fault in self.model.faults:
            fault.assemble(tractions[fault.name], force)
        return force

    def tractions(self, state: State) -> dict[str, np.ndarray]:
        """Return T - T_0 [Pa] of a state by fault, tension positive, shape (n, local)."""
        entries = {}
        for fault in self.model.faults:
            fields = state.faults[fault.name]
            change = [fault.components(fields, "shear_traction") - fault.driving_shear(state.time)]
            if fault.interface.has_normal:
                change.insert(0, (fault.normal_stress_0 - fields["normal_stress"])[:, None])
            entries[fault.name] = np.concatenate(change, axis=1)
        return entries

    def carried(self, state: State) -> np.ndarray:
        """Return internal and damping forces less the load of a state [N]."""
        carried: np.ndarray = self.internal(state) + self.damping_force(state.velocity) - self.load(state.time)
        return carried

    def acceleration(self, force: np.ndarray) -> np.ndarray:
        """Return the acceleration by a nodal force [m/s2], the same for tied nodes; zero for prescribed motion."""
        force, mass = force.copy(), self.model.mass.copy()
        for each in (force, mass):
            self.model.layout.sum_tied(each)
        return np.where(self._driven, 0.0, force / mass)

    def count_work(self, state: State, solution: Solution, velocity: np.ndarray, carried: np.ndarray) -> None:
        """Add work of loads and driven edges and loss in damping to the energies of a state; before `commit`.

        Mean forces over the step are used, exact for average acceleration.

        Parameters
        ----------
        velocity : ndarray, shape (nodes * components,)
            Velocity at the end of the step [m/s].
        carried : ndarray, shape (nodes * components,)
            `carried` at the beginning of the step [N].
        """
        mass, dot = self.model.mass, self.model.layout.owned_dot
        moved = solution.displacement - state.displacement
        load, before = self.load(state.time + solution.dt), self.load(state.time)
        damped, damped_before = self.damping_force(velocity), self.damping_force(state.velocity)
        state.energy["damping"] += 0.5 * dot(damped_before + damped, moved)
        state.energy["boundary_work"] += 0.5 * dot(before + load, moved)
        # Driven edges do the work of their reactions, and that of accelerating their own mass.
        reaction = 0.5 * (carried + solution.internal + damped - load)
        inertia = 0.5 * mass * (velocity**2 - state.velocity**2)
        state.energy["boundary_work"] += dot(self._driven.astype(float), reaction * moved + inertia)
