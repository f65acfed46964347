"""Common parts of steps without inertia: energies of equilibrium and loss by radiation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.free_motions import refuse_free_bodies
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.steppers._adaptive import AdaptiveMotion, Result
from ruptfx.stepping.steppers._radiation import radiation_impedance

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.solution import Solution


class SlowMotion(AdaptiveMotion[Result]):
    """Steps from one equilibrium to the next; `State.velocity` is the mean velocity of the last step.

    Attributes
    ----------
    radiation : dict of str to ndarray, shape (n,)
        Impedance of radiation damping, traction per slip rate, by fault [Pa s/m]; zero without it.
    """

    def __init__(self, model: System, radiates: bool, petsc_options: PetscOptions | None = None) -> None:
        self.model = model
        if model.section is None:
            refuse_free_bodies(model)
        self.radiation = {
            f.name: radiation_impedance(model, f) if radiates else np.zeros(len(f.interface.plus)) for f in model.faults
        }
        self.equilibrium = self._make_equilibrium(petsc_options)
        self._driven = model.loads.prescribed.astype(float)

    def _make_equilibrium(self, petsc_options: PetscOptions | None) -> Equilibrium:
        return Equilibrium(self.model, petsc_options, self.radiation)

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies at the end of the step [J]."""
        return self.model.energies(state)

    def count_radiation(self, state: State, solution: Solution) -> None:
        """Count radiation as damping, which is part of traction times slip rate and thus of friction; before `take`."""
        for fault in self.model.faults:
            radiated = self._radiated(fault, state, solution)
            state.energy["frictional_dissipation"] -= radiated
            state.energy["damping"] += radiated

    def take(self, state: State, solution: Solution) -> None:
        """Copy a solution to the state, and count the work of the step."""
        moved = self._account(state, solution)
        solution.commit(state)
        self._lose_kinetic(state, moved / solution.dt)

    def _account(self, state: State, solution: Solution) -> np.ndarray:
        """Count the work of the step and return its displacement increment [m].

        The work of driven edges and loads goes into bodies and interfaces. Work of unbalanced forces at the start, such
        as those of waves that are no longer computed, is lost.
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
        power = 0.5 * self.radiation[fault.name] * np.sum((old + new) * mean, axis=1) * ~fault.is_held
        return float(np.sum(fault.interface.owned * fault.interface.weight * power)) * solution.dt

    def _lose_kinetic(self, state: State, velocity: np.ndarray) -> None:
        """Set the velocity and count the change of kinetic energy as lost, since equilibrium has no inertia."""
        mass, dot = self.model.mass, self.model.layout.owned_dot
        state.energy["damping"] += 0.5 * (dot(state.velocity, mass * state.velocity) - dot(velocity, mass * velocity))
        state.velocity[:] = velocity
