"""What steps without inertia share: the energies of equilibrium, and what radiation takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.implicit.equilibrium import Equilibrium
from ruptfx.implicit.options import PetscOptions
from ruptfx.radiation import radiation_impedance

if TYPE_CHECKING:
    from ruptfx.fault import Fault
    from ruptfx.implicit.solution import Solution
    from ruptfx.model import Model
    from ruptfx.state import State


class SlowMotion:
    """From one equilibrium to the next; `State.velocity` is the mean one of the last step.

    Attributes
    ----------
    radiation : dict of str to ndarray, shape (n,)
        Traction per slip rate that waves would carry off, by fault [Pa s/m]; zero where it is not asked for.
    """

    collective = True

    def __init__(self, model: Model, radiates: bool, petsc_options: PetscOptions | None = None) -> None:
        self.model = model
        self.radiation = {
            f.name: radiation_impedance(model, f) if radiates else np.zeros(len(f.interface.plus)) for f in model.faults
        }
        self.equilibrium = Equilibrium(model, petsc_options, self.radiation)
        self._driven = model.loads.prescribed.astype(float)

    def energies(self, state: State) -> dict[str, float]:
        """At the end of the step."""
        return self.model.energies(state)

    def count_radiation(self, state: State, solution: Solution) -> None:
        """As damping: it is part of the traction times the slip rate that counts as friction; before `take`."""
        for fault in self.model.faults:
            radiated = self._radiated(fault, state, solution)
            state.energy["frictional_dissipation"] -= radiated
            state.energy["damping"] += radiated

    def take(self, state: State, solution: Solution) -> None:
        """Make it the state, and count the work of the step."""
        moved = self._account(state, solution)
        solution.commit(state)
        self._lose_kinetic(state, moved / solution.dt)

    def _account(self, state: State, solution: Solution) -> np.ndarray:
        """Count the work done in the step; the displacement added in it [m].

        Bodies and interfaces take what driven edges and loads give, and what forces out of balance at the start, such
        as those of waves that are no longer computed, lose.
        """
        model, time = self.model, state.time
        loads = [self.equilibrium.forces.load(t) for t in (time, time + solution.dt)]
        begun = self.equilibrium.forces.internal(state) if solution.begun is None else solution.begun
        before, after = begun - loads[0], solution.internal - loads[1]
        moved = solution.displacement - state.displacement
        mean = 0.5 * (before + after)
        dot = model.layout.owned_dot
        state.energy["boundary_work"] += dot(0.5 * (loads[0] + loads[1]) + self._driven * mean, moved)
        state.energy["damping"] -= dot((1 - self._driven) * mean, moved)
        return moved

    def _radiated(self, fault: Fault, state: State, solution: Solution) -> float:
        old, new = (fault.components(fields[fault.name], "slip_rate") for fields in (state.faults, solution.faults))
        mean = fault.components(solution.faults[fault.name], "mean_slip_rate")
        power = 0.5 * self.radiation[fault.name] * np.sum((old + new) * mean, axis=1)
        return float(np.sum(fault.interface.owned * fault.interface.weight * power)) * solution.dt

    def _lose_kinetic(self, state: State, velocity: np.ndarray) -> None:
        """Take over the velocity; equilibrium knows no inertia, so the change of kinetic energy is lost or gained."""
        mass, dot = self.model.mass, self.model.layout.owned_dot
        state.energy["damping"] += 0.5 * (dot(state.velocity, mass * state.velocity) - dot(velocity, mass * velocity))
        state.velocity[:] = velocity
