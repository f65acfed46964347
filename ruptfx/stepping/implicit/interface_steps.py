"""Quasi-static steps of linear bodies on the interfaces alone, while no output needs the bodies.

Newton's iteration is that of `condensed`; here are its right-hand side and the update of the bodies.

The boundaries change by amounts a_m only: displacements of edges and factors of loads. From a state in equilibrium,
the base b, displacement and jumps g = J u are, with A, k and S = J A^-1 J' W of `condensed`,

    u = u_b + sum_m (a_m - a_m,b) w_m - A^-1 J' W p,    p = (t - t_b) - k (g - g_b),
    g = J u_b + sum_m (a_m - a_m,b) J w_m - S p,

w_m being the response of the bodies, with sticking interfaces, to a unit of the amount m. A step solves the second
line for the jumps as `condensed` does; the first takes a back substitution for the displacement and one for the
velocity, together, when output needs them (`advance_bodies`). Results do not depend on when that is: it changes no
bit of later steps, and a restarted run has bitwise the same results.

The work of boundaries on bodies in equilibrium at both ends of a step is the change of strain energy, and interfaces
take the mean traction times the change of the jump. Only the latter is counted step by step: from `begin` to `end` the
strain energy is left out of `State.energy["boundary_work"]`, and kinetic energy, which equilibrium loses, of
`State.energy["damping"]`; `energies` adds them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ruptfx.interfaces.faults.fields import plan_fields
from ruptfx.platform import parallel
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.condensed import Condensed, Guess, Start, blockwise_product, traction_change
from ruptfx.stepping.implicit.solution import Solution
from ruptfx.stepping.implicit.solvers import TOLERANCE
from ruptfx.stepping.implicit.step import FAR, Step, Terms

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.compliance import Compliance, Jumps

BASE, SINCE, BEFORE = "deferred_base", "deferred_since", "deferred_before"


class CarriedPoints(NamedTuple):
    """Values at the points of an interface that one step hands to the next, shape (points, local).

    Attributes
    ----------
    jump, jump_rate : ndarray
        Displacement jump at the end of the last step [m], and its rate in that step [m/s].
    traction_rate : ndarray
        Rate of the tractions in the last step [Pa/s].
    base_traction : ndarray
        T - T_0 of the base [Pa].
    """

    jump: np.ndarray
    jump_rate: np.ndarray
    traction_rate: np.ndarray
    base_traction: np.ndarray

    @classmethod
    def of(cls, columns: FaultState) -> CarriedPoints:
        """Return the arrays from `columns`."""
        local = range(len(columns) // len(cls._fields))
        return cls(*(np.stack([columns[f"deferred.{n}.{k}"] for k in local], axis=1) for n in cls._fields))

    def columns(self) -> FaultState:
        """Return the components as fields of points, which checkpoints contain."""
        # No field of a law has a dot in its name.
        arrays = self._asdict().items()
        return {f"deferred.{name}.{k}": each for name, array in arrays for k, each in enumerate(array.T.copy())}


@dataclass
class Carried:
    """State that one step on the interfaces hands to the next.

    Attributes
    ----------
    base : ndarray, shape (nodes * components,)
        Displacement of the bodies in equilibrium, from which steps are counted [m].
    since, before : float
        Times of the base and of the start of the last step [s].
    points : dict of str to CarriedPoints
        By fault.
    """

    base: np.ndarray
    since: float
    before: float
    points: dict[str, CarriedPoints]

    @classmethod
    def of(cls, state: State) -> Carried | None:
        """Return what a state carries, None if its bodies are up to date and no step has begun from them."""
        if SINCE not in state.numbers:
            return None
        points = {name: CarriedPoints.of(columns) for name, columns in state.points.items()}
        return cls(state.fields[BASE], state.numbers[SINCE], state.numbers[BEFORE], points)

    def store(self, state: State) -> None:
        """Set it in a state."""
        state.fields[BASE], state.numbers[SINCE], state.numbers[BEFORE] = self.base, self.since, self.before
        state.points |= {name: points.columns() for name, points in self.points.items()}

    @staticmethod
    def remove(state: State) -> None:
        """Remove it from a state."""
        del state.numbers[SINCE], state.numbers[BEFORE], state.fields[BASE]
        state.points.clear()


def fits(model: System) -> bool:
    """Return whether no interface has finite sliding and all loads and motions of edges only change by a factor."""
    if any(fault.slides for fault in model.faults):
        return False
    loads = model.loads
    amounts = [motion.displacement for motion in loads.motions] + [force.factor for force in loads.forces]
    return not any(np.ndim(amount(loads.start)) for amount in amounts)


@dataclass
class InterfaceSolution(Solution):
    """An equilibrium with its displacement known at driven edges only; elsewhere it is that of an earlier state.

    Attributes
    ----------
    jumps, tractions : dict of str to ndarray, shape (n, local)
        Displacement jump [m] and T - T_0 [Pa] by fault.
    """

    jumps: dict[str, np.ndarray] = field(default_factory=dict)
    tractions: dict[str, np.ndarray] = field(default_factory=dict)


class LoadPath:
    """A load or edge motion with an amount that changes in time.

    Parameters
    ----------
    amount : callable, time -> float
        Displacement of an edge [m], or factor of a load.
    make : callable, compliance -> ndarray of shape (nodes * components,)
        Returns the response of the bodies to a unit of it.
    jumps : Jumps
    """

    def __init__(
        self, amount: Callable[[float], float | np.ndarray], make: Callable[[Compliance], np.ndarray], jumps: Jumps
    ) -> None:
        self._amount, self._make, self._jumps = amount, make, jumps
        self._answers: dict[Compliance, tuple[np.ndarray, np.ndarray]] = {}

    def grown(self, start: float, end: float) -> float:
        """Return the change of the amount between two times [s]."""
        return float(self._amount(end)) - float(self._amount(start))

    def answer(self, compliance: Compliance) -> tuple[np.ndarray, np.ndarray]:
        """Return the response to a unit and its jump at all points, shape (points, local); collective."""
        if compliance not in self._answers:
            made = self._make(compliance)
            self._answers[compliance] = made, self._jumps.of(made)
        return self._answers[compliance]


class DeferredBodies:
    """Bodies that are updated later: the iteration starts from expected jumps, and rounding decides on its root.

    Parameters
    ----------
    steps : InterfaceSteps
    solver : Condensed
    carried : Carried
    points : CarriedPoints
        Carried values at all points of all faults.
    expected : ndarray, shape (points, local)
        Jumps at the end of the step [m].

    Attributes
    ----------
    ends : ndarray, shape (points, local)
        Jumps of the root [m].
    is_uncertain : bool
        Whether rounding or a law that failed leave the equilibrium to the full system.
    """

    def __init__(
        self, steps: InterfaceSteps, solver: Condensed, carried: Carried, points: CarriedPoints, expected: np.ndarray
    ) -> None:
        self._steps, self._solver, self._carried, self._points = steps, solver, carried, points
        self.ends, self.converged, self.is_uncertain, self._begun = expected, False, False, False

    def start(self, step: Step) -> Start | None:
        if self._begun:
            return None
        self._begun = True
        solver, points, expected = self._solver, self._points, self.ends
        compliance, base_jump = solver.compliance(step), solver.jumps.of(self._carried.base)
        begin = solver.tractions(step, expected)
        self.is_uncertain = begin is None
        if begin is None:
            return None
        driven = base_jump - expected
        for path, part in self._steps.grown(self._carried.since, step.time):
            driven += part * path.answer(compliance)[1]
        # Responses are those of bodies with sticking interfaces, from whose tractions the others differ.
        sticking = blockwise_product(compliance.stuck, expected - base_jump)
        driven -= compliance.jumps_under(traction_change(begin.value, points.base_traction, sticking))
        forces, self._least = self._steps.sizes(step, expected)
        return Start(compliance, expected, driven, max(TOLERANCE * forces, self._least))

    def correct(self, step: Step, start: Start, root: Guess) -> None:
        self.ends = start.jumps + root.e
        forces, rounding = self._steps.sizes(step, self.ends)
        # Unsupported bodies fly far: rounding counts in proportion to the forces.
        allowed = max(FAR * forces, 2 * self._least)
        accepted = max(start.enough, min(5 * rounding, allowed))
        self.converged = rounding <= allowed and self._solver.residual_bound(start.influence, root) <= accepted
        self.is_uncertain = not self.converged


class InterfaceSteps:
    """Steps on the interfaces of one model, from a base state until output needs the bodies.

    Parameters
    ----------
    equilibrium : Terms
    solver : Condensed
    """

    def __init__(self, equilibrium: Terms, solver: Condensed) -> None:
        self._equilibrium, self._solver, self._model = equilibrium, solver, equilibrium.model
        self._load_paths = list(self._all_load_paths())
        self._log = logging.getLogger("ruptfx.run")

    def _all_load_paths(self) -> Iterator[LoadPath]:
        loads, size, jumps = self._model.loads, len(self._model.mass), self._solver.jumps
        for number, motion in enumerate(loads.motions):
            unit = np.zeros(size)
            unit[motion.dofs] = 1.0
            for later in loads.motions[number + 1 :]:  # the last one counts, as in `Loads.moved`
                unit[later.dofs] = 0.0
            yield LoadPath(motion.displacement, partial(self._moved, unit), jumps)
        for force in loads.forces:
            nodal = np.zeros(size)
            nodal[force.dofs] = force.values
            yield LoadPath(force.factor, partial(self._loaded, nodal), jumps)

    def _moved(self, unit: np.ndarray, compliance: Compliance) -> np.ndarray:
        """Return the displacement under moved edges with sticking interfaces; collective."""
        jumps = self._solver.jumps
        sticking = blockwise_product(compliance.stuck, jumps.of(unit))
        return unit + compliance.solve(self._model.internal_force(unit) - jumps.force(sticking, len(unit)))

    @staticmethod
    def _loaded(nodal: np.ndarray, compliance: Compliance) -> np.ndarray:
        """Return the displacement under nodal forces [N]; collective."""
        return compliance.solve(nodal)

    def begin(self, state: State) -> None:
        """Begin steps on the interfaces with a state in equilibrium; collective."""
        # The energies of the bodies are not known in these steps: sums contain what follows from the interfaces alone.
        self._leave_out(state, 1.0)
        traction = self._equilibrium.forces.tractions(state)
        Carried(state.displacement.copy(), state.time, state.time, {
            fault.name: CarriedPoints(
                fault.interface.jump(state.displacement), fault.interface.rate(state.velocity),
                np.zeros_like(traction[fault.name]), traction[fault.name],
            ) for fault in self._model.faults
        }).store(state)  # fmt: skip

    def end(self, state: State) -> None:
        """Complete a state as if no step had been made on the interfaces alone; collective."""
        self.advance_bodies(state)
        if Carried.of(state) is not None:  # else it had none, or the bodies were out of balance
            self._leave_out(state, -1.0)
            Carried.remove(state)

    def _leave_out(self, state: State, sign: float) -> None:
        """Leave the energies of bodies out of the sums of steps, or count them again; collective."""
        kinetic, strain = self._model.bulk_energies(state)
        state.energy["boundary_work"] -= sign * strain
        state.energy["damping"] += sign * kinetic

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies over all ranks [J]; collective."""
        self.advance_bodies(state)
        energies = self._model.energies(state)
        if Carried.of(state) is not None:
            energies["boundary_work"] += energies["strain"]
            energies["damping"] -= energies["kinetic"]
        return energies

    def solve(self, state: State, carried: Carried, dt: float) -> InterfaceSolution | None:
        """Return the equilibrium at state.time + dt, with `state` unchanged; collective.

        Returns
        -------
        InterfaceSolution or None
            None where rounding makes it uncertain: the full system then decides.

        Raises
        ------
        ConvergenceError
            On all ranks: no equilibrium at the interfaces, and so none of the full system, which is equivalent.
        """
        plan_fields(self._model.faults, state, dt)
        solver, jumps, points = self._solver, self._solver.jumps, self._gathered(carried)
        expected = points.jump + dt * points.jump_rate + self._gained(state, dt)
        iterations, outer, uncertain = 0, 0, False
        for easing in self._equilibrium.easings:
            step = self._step(state, dt, easing)
            bodies = DeferredBodies(self, solver, carried, points, expected)
            balanced = solver.iterate(step, bodies)
            iterations, outer, uncertain = (
                iterations + solver.iterations, outer + solver.outer, uncertain or bodies.is_uncertain
            )  # fmt: skip
            if balanced:
                return InterfaceSolution(
                    step.driven, np.zeros(0), {name: response.state for name, response in step.responses.items()}, dt,
                    iterations, outer, list(solver.history), 0.0, self._equilibrium.answers,
                    jumps={name: jumps.pick(bodies.ends, name) for name in step.responses},
                    tractions={name: response.traction for name, response in step.responses.items()},
                )  # fmt: skip
        if not uncertain:
            raise ConvergenceError(
                f"no equilibrium at time {state.time + dt:.6g} s, step of {dt:.4g} s: {solver.reason}"
            )
        return None

    def _gained(self, state: State, dt: float) -> np.ndarray:
        """Return the jump gained by slip that accelerates as in the previous step [m]; collective."""
        gained, longer = {}, 1 + dt / state.numbers["dt_before"]
        for fault in self._model.faults:
            rate, mean = (fault.components(state.faults[fault.name], name) for name in ("slip_rate", "mean_slip_rate"))
            jump = np.zeros(fault.interface.frame.shape[:2])
            jump[:, int(fault.interface.has_normal) :] = dt * longer * (rate - mean)
            gained[fault.name] = jump
        return self._solver.jumps.gather(gained)

    def commit(self, state: State, solution: InterfaceSolution) -> None:
        """Set the state at the end of the step, except for the bodies, and count the work of the boundaries."""
        before, carried = self._equilibrium.forces.tractions(state), Carried.of(state)
        assert carried is not None
        for fault in self._model.faults:
            name, face, old = fault.name, fault.interface, carried.points[fault.name]
            traction, change, dt = solution.tractions[name], solution.jumps[name] - old.jump, solution.dt
            mean = 0.5 * (before[name] + traction)
            state.energy["boundary_work"] += float(np.sum((face.owned * face.weight)[:, None] * mean * change))
            rates = change / dt, (traction - before[name]) / dt
            carried.points[name] = CarriedPoints(solution.jumps[name], *rates, old.base_traction)
        replace(carried, before=state.time).store(state)
        solution.commit(state)
        state.deferred = True

    def advance_bodies(self, state: State) -> None:
        """Update displacement and velocity of the bodies if they are deferred; collective."""
        carried = Carried.of(state)
        if not state.deferred or carried is None:
            return
        state.deferred = False
        model, jumps, points = self._model, self._solver.jumps, self._gathered(carried)
        compliance = self._solver.compliance(self._step(state, 1.0, 1.0))
        traction = jumps.gather(self._equilibrium.forces.tractions(state))
        sticking = blockwise_product(compliance.stuck, points.jump - jumps.of(carried.base))
        rate = points.traction_rate - blockwise_product(compliance.stuck, points.jump_rate)
        pulls = traction_change(traction, points.base_traction, sticking), rate
        forces = (jumps.force(-pull, len(carried.base)) for pull in pulls)
        displacement, velocity = compliance.solve_each(forces, 2)
        displacement += carried.base
        for path, part in self.grown(carried.since, state.time):
            displacement += part * path.answer(compliance)[0]
        for path, part in self.grown(carried.before, state.time):
            velocity += part / (state.time - carried.before) * path.answer(compliance)[0]
        free = ~model.loads.prescribed
        state.displacement[free] = displacement[free]  # driven edges have their prescribed position bitwise
        state.velocity[:] = velocity
        self._check(state)

    def _step(self, state: State, dt: float, easing: float) -> Step:
        """Return a step for its interfaces only."""
        return Step(self._equilibrium, state, dt, None, np.zeros(0), easing)

    def grown(self, start: float, end: float) -> Iterator[tuple[LoadPath, float]]:
        """Yield the loads and motions that have changed between two times [s], and the changes of their amounts."""
        for path in self._load_paths:
            part = path.grown(start, end)
            if part:
                yield path, part

    def _gathered(self, carried: Carried) -> CarriedPoints:
        """Return what is carried at all points of all faults, by one message; collective."""
        stacked = {name: np.stack(points, axis=2) for name, points in carried.points.items()}
        return CarriedPoints(*np.moveaxis(self._solver.jumps.gather(stacked), 2, 0))

    def sizes(self, step: Step, jump: np.ndarray) -> tuple[float, float]:
        """Return norms of the forces of interfaces and of their rounding [N]; collective."""
        ours = step.at_interfaces({f.name: self._solver.jumps.pick(jump, f.name) for f in self._model.faults})
        carried, stiff = np.sqrt(parallel.total(self._model.comm, list(ours)))
        return float(carried), float(2 * np.finfo(float).eps * stiff)

    def _check(self, state: State) -> None:
        """Remove the base if the bodies are out of balance in the full system; collective."""
        model, forces = self._model, self._equilibrium.forces
        elastic, load = -model.internal_force(state.displacement), forces.load(state.time)
        pull = np.zeros_like(load)
        for fault in model.faults:
            fault.interface.assemble(forces.tractions(state)[fault.name], pull)
        reduce = model.layout.reduce_tied
        residual = np.where(model.loads.prescribed, 0.0, reduce(elastic + pull - load))
        stiff = self._equilibrium.tangent.diagonal * state.displacement
        left, rounding, *sizes = np.sqrt(parallel.total(model.comm, [
            model.layout.owned_dot(each, each) for each in (residual, stiff, *map(reduce, (elastic, pull, load)))
        ]))  # fmt: skip
        if left > max(10 * TOLERANCE * max(sizes), min(100 * np.finfo(float).eps * rounding, FAR * max(sizes))):
            self._log.warning(
                "bodies are out of balance by %.3g N of %.3g N at %.9g s: the next step is solved as a whole",
                left, max(sizes), state.time,
            )  # fmt: skip
            self.end(state)
