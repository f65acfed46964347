"""The equilibrium an implicit step ends in: one nonlinear solve for the displacement, shared by implicit steppers.

    R(u) = M a(u) + C v(u) + eta K_v v(u) + K u + J' W (T(u) - T_0) - F = 0

with a = c_M (u - u*) and v = v* + c_C (u - u*), which is what Newmark's rules are (`Rates`), or without them in
quasi-static steps. T(u) is the traction at the end of the step that the contact method and the shared projection
answer to the jump of u, with the state of the friction law advanced inside, and its exact tangent (`response`).
Driven edges are Dirichlet conditions. PETSc's SNES (Newton with line search) and KSP solve it (`solvers`).

    equilibrium = Equilibrium(model, petsc_options)
    solution = equilibrium.solve(state, dt)              # quasi-static: to state.time + dt
    solution = equilibrium.solve(state, dt, Rates(...))  # dynamic
    solution.commit(state)                               # or not: `state` was left alone until here

`solve` raises `ConvergenceError` on all ranks, and leaves everything as it was, so that a step can be halved and tried
again. `commit` takes over displacement and fault fields, counts the energy that the faults dissipated and nucleation
put in, and advances `state.time` and `state.step`; velocity and what else belongs to a scheme is the stepper's.

Contact methods with multipliers (`augmented_lagrangian`) are solved in outer iterations: the tractions of the last
solution are the multipliers of the next, until they change no more. At the end of a step multipliers and tractions are
the same, so that they are in the state, and in checkpoints, by themselves.

The matrix is factorised again only when the step or the tangent of an interface has changed. PETSc options of the case
override the defaults: ``petsc_options = { snes_monitor = true, ksp_type = "fgmres" }``; an option nobody reads is an
error. `snes_rtol` bounds the norm of R over that of the forces in it (`Solution.scale`), `snes_atol` is in newton.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ruptfx import RuptfxError, fem, parallel
from ruptfx.contact import require
from ruptfx.fault import Fault, FaultState
from ruptfx.interface import Interface
from ruptfx.model import Model, State
from ruptfx.projection import ProjectionError
from ruptfx.response import FaultResponse, Response
from ruptfx.solvers import NewtonSolver
from ruptfx.steppers._options import PetscOptions
from ruptfx.tangent import Tangent

MAX_OUTER = 100
# What the penalty of multipliers is multiplied by, until Newton's iteration finds out which points slide: the larger
# it is the fewer outer iterations, but the harder is that.
EASINGS = (1.0, 0.1, 0.01)


class ConvergenceError(RuptfxError):
    """An implicit step that found no equilibrium; raised on all ranks, the state is as before the step."""


@dataclass(frozen=True)
class Rates:
    """Velocity and acceleration as functions of the unknown displacement u.

    Attributes
    ----------
    mass : float
        c_M in a = c_M (u - displacement) [1/s2].
    damping : float
        c_C in v = velocity + c_C (u - displacement) [1/s].
    displacement, velocity : ndarray, shape (nodes * components,)
        Predictors [m], [m/s].
    """

    mass: float
    damping: float
    displacement: np.ndarray
    velocity: np.ndarray

    def acceleration_of(self, u: np.ndarray) -> np.ndarray:
        return self.mass * (u - self.displacement)

    def velocity_of(self, u: np.ndarray) -> np.ndarray:
        return self.velocity + self.damping * (u - self.displacement)


@dataclass
class Solution:
    """An equilibrium, not yet part of the state.

    Attributes
    ----------
    displacement : ndarray, shape (nodes * components,)
        At the end of the step [m], complete at ghosts.
    internal : ndarray, shape (nodes * components,)
        K u + J' W (T - T_0) [N] at every local node: what bodies and interfaces resist.
    faults : dict of str to FaultState
        New fault fields.
    dt : float
        Length of the step [s].
    iterations, outer : int
        Newton iterations in all, and outer ones of the multipliers (1 without).
    residuals : list of float
        Norm of R after every Newton iteration [N].
    scale : float
        Norm of the largest of the forces that balance [N].
    tangents : dict of str to ndarray, shape (n, local, local)
        dT / d[u] by fault [Pa/m], of `Equilibrium.answer`.
    """

    displacement: np.ndarray
    internal: np.ndarray
    faults: dict[str, FaultState]
    dt: float
    iterations: int
    outer: int
    residuals: list[float]
    scale: float
    _answers: dict[str, FaultResponse] = field(repr=False, default_factory=dict)
    tangents: dict[str, np.ndarray] = field(repr=False, default_factory=dict)

    def commit(self, state: State) -> None:
        """Make it the state at the end of the step; arrays of the state keep their place."""
        state.displacement[:] = self.displacement
        state.time += self.dt
        state.step += 1
        state.numbers["dt_before"] = self.dt
        for name, answer in self._answers.items():
            answer.commit(state, self.faults[name], self.dt)


class Equilibrium:
    """Solves for the displacement at the end of a step.

    Parameters
    ----------
    model : Model
    petsc_options : dict, optional
        PETSc options without dash and prefix: snes_..., ksp_..., pc_..., mat_....
    radiation : dict of str to float or ndarray, optional
        Impedance [Pa s/m] of waves that are not computed, by fault; see `FaultResponse`.

    Raises
    ------
    CaseError
        A contact method for explicit steps only.
    """

    def __init__(
        self, model: Model, petsc_options: PetscOptions | None = None, radiation: dict[str, Any] | None = None
    ) -> None:
        self.model = model
        require(model.faults, "implicit")
        threshold = model.case.output.rupture_threshold
        self._answers = {f.name: FaultResponse(f, threshold, (radiation or {}).get(f.name, 0.0)) for f in model.faults}
        self._multipliers = any(fault.contact.multiplier_tolerance() is not None for fault in model.faults)
        self._owned = model.owned_nodes * model.components
        self._driven = model.loads.prescribed
        self.dashpot = model.loads.dashpot + model.case.damping.mass * model.mass
        self.tangent = Tangent(model, self.dashpot)
        self._ghosted = fem.dolfinx.fem.Function(model.space)
        self._task: _Task
        self._solver = NewtonSolver(
            model, self.tangent.matrix, petsc_options or {}, self._function, self._differentiate,
            lambda rtol: max(rtol * self._task.scale, self._task.round_off),
        )

    # -- forces ------------------------------------------------------------------------------------------------------

    def load(self, time: float) -> np.ndarray:
        """F: nodal force of the boundaries [N]."""
        return self.model.loads.force(time)

    def damping_force(self, velocity: np.ndarray) -> np.ndarray:
        """C v + eta K_v v [N]: dashpots, mass damping and the Kelvin-Voigt layer."""
        force, viscosity = self.dashpot * velocity, self.model.viscosity
        if viscosity is not None:
            layer = np.zeros_like(force)
            viscosity.operator.add_internal_force(velocity, layer)
            self.model.sum_shared(layer)
            force -= viscosity.eta * layer
        return force

    def internal(self, state: State) -> np.ndarray:
        """K u + J' W (T - T_0) [N] of a state, from the tractions it holds."""
        force = -self.model.internal_force(state.displacement)
        for fault in self.model.faults:
            fields = state.faults[fault.name]
            change = [fault.components(fields, "shear_traction") - fault.driving_shear(state.time)]
            if fault.interface.has_normal:
                change.insert(0, (fault.normal_stress_0 - fields["normal_stress"])[:, None])
            fault.interface.assemble(np.concatenate(change, axis=1), force)
        return force

    def carried(self, state: State) -> np.ndarray:
        """Internal and damping forces less the load of a state [N]."""
        return self.internal(state) + self.damping_force(state.velocity) - self.load(state.time)

    def count_work(self, state: State, solution: Solution, velocity: np.ndarray, carried: np.ndarray) -> None:
        """Add to the energies of a state, before `commit`, the work of loads and driven edges and what damping takes,
        by the mean forces over the step: exact for average acceleration.

        Parameters
        ----------
        velocity : ndarray, shape (nodes * components,)
            At the end of the step [m/s].
        carried : ndarray, shape (nodes * components,)
            `carried` at its beginning [N].
        """
        mass, dot = self.model.mass, self.model.owned_dot
        moved = solution.displacement - state.displacement
        load, before = self.load(state.time + solution.dt), self.load(state.time)
        damped, damped_before = self.damping_force(velocity), self.damping_force(state.velocity)
        state.energy["damping"] += 0.5 * dot(damped_before + damped, moved)
        state.energy["boundary_work"] += 0.5 * dot(before + load, moved)
        # Driven edges do what their reactions do, and what sets their own mass in motion.
        reaction = 0.5 * (carried + solution.internal + damped - load)
        inertia = 0.5 * mass * (velocity**2 - state.velocity**2)
        state.energy["boundary_work"] += dot(self._driven.astype(float), reaction * moved + inertia)

    # -- the solve ---------------------------------------------------------------------------------------------------

    def solve(
        self,
        state: State,
        dt: float,
        rates: Rates | None = None,
        added: np.ndarray | float = 0.0,
        guess: np.ndarray | None = None,
    ) -> Solution:
        """The equilibrium at state.time + dt; collective, `state` is left alone.

        Parameters
        ----------
        state : State
            At the beginning of the step.
        dt : float
            Length of the step [s].
        rates : Rates, optional
            Without it nothing depends on velocity but friction: quasi-static.
        added : ndarray, shape (nodes * components,)
            Force added to F [N], e.g. what a scheme carries over from the last step.
        guess : ndarray, shape (nodes * components,), optional
            Displacement to begin with where nothing is driven; otherwise the present one.

        Raises
        ------
        ConvergenceError
            On all ranks: no convergence, with the history of the residual and the worst point.
        CaseError
            On all ranks: PETSc options that nobody reads.
        """
        load = self.load(state.time + dt) + added
        self._residuals: list[float] = []
        iterations = 0
        for easing in EASINGS if self._multipliers else (1.0,):
            self._task = task = _Task(self, state, dt, rates, load, easing)
            u = (state.displacement if guess is None else guess).copy()
            u[self._driven] = task.driven[self._driven]
            outer = 0
            while outer < MAX_OUTER:
                converged = self._solver.solve(u[: self._owned])
                outer += 1
                iterations += self._solver.snes.getIterationNumber()
                self._residuals += self._solver.history
                if not converged:
                    break
                self._visit(self._solver.unknown.array_r)
                u = task.displacement
                if self._settled(task):
                    faults = {name: response.state for name, response in task.responses.items()}
                    return Solution(
                        u, task.internal, faults, dt, iterations, outer, self._residuals, task.scale, self._answers
                    )
                task.update_multipliers()
        raise self._failure(task, outer)

    def _settled(self, task: _Task) -> bool:
        """Whether the multipliers are the tractions; collective, for it follows from the case."""
        settled = True
        for fault in self.model.faults:
            tolerance = fault.contact.multiplier_tolerance()
            if tolerance is None:
                continue
            now, before = task.responses[fault.name].state, task.multipliers[fault.name]
            tractions = [_tractions(fault, fields) for fields in (now, before)]
            change = np.abs(tractions[0] - tractions[1]).max(initial=0)
            size = max(np.abs(fault.normal_stress_0).max(initial=0), np.abs(tractions[0]).max(initial=0))
            change, size = (parallel.largest(self.model.comm, value) for value in (change, size))
            settled = settled and change <= tolerance * size
        return settled

    def _visit(self, unknown: np.ndarray) -> None:
        """Evaluate at the owned unknowns unless that was done last; collective."""
        task = self._task
        new = not np.array_equal(task.displacement[: self._owned], unknown)
        if parallel.anywhere(self.model.comm, new):
            self._ghosted.x.array[: self._owned] = unknown
            self._ghosted.x.scatter_forward()
            task.evaluate(self._ghosted.x.array)

    def _function(self, _: Any, x: Any, out: Any) -> None:
        """SNES asks for R(u)."""
        self._visit(x.array_r)
        out.array[:] = self._task.residual[: self._owned]

    def _differentiate(self, _: Any, x: Any, __: Any, ___: Any) -> None:
        """SNES asks for dR/du."""
        self._visit(x.array_r)
        task = self._task
        factors = (task.rates.mass, task.rates.damping) if task.rates else (0.0, 0.0)
        symmetric = self.tangent.update(*factors, task.tangents, driven=self.tangent.unit)
        if symmetric is not None:
            self._solver.use_symmetric(symmetric)

    def answer(self, state: State, dt: float, u: np.ndarray) -> Solution:
        """What bodies and faults answer after `dt` to any displacement, balanced or not; collective.

        Raises
        ------
        ProjectionError
            On all ranks: an interface without an admissible traction.
        """
        task = _Task(self, state, dt, None, np.zeros_like(u), 1.0)
        task.evaluate(u)
        parallel.raise_on_all(self.model.comm, task.error)
        faults = {name: response.state for name, response in task.responses.items()}
        return Solution(u.copy(), task.internal, faults, dt, 0, 0, [], task.scale, self._answers, task.tangents)

    def body_stiffness(self, interface: Interface, rates: Rates | None) -> np.ndarray:
        """Diagonal of K and inertia over the area of every point, of its softer side [Pa/m]."""
        diagonal = self.tangent.diagonal + (rates.mass * self.model.mass if rates else 0.0)
        nodal = diagonal.reshape(self.model.nodes, -1).max(axis=1)
        return np.minimum(nodal[interface.plus], nodal[interface.minus]) / interface.weight

    def _failure(self, task: _Task, outer: int) -> ConvergenceError:
        """What to say; collective."""
        model = self.model
        size = np.abs(task.residual[: self._owned])
        size = np.where(np.isfinite(size), size, np.inf)
        worst = int(np.argmax(size)) if len(size) else 0
        node = worst // model.components
        told = "(" + ", ".join(f"{value:.6g}" for value in model.coordinates[node]) + ") m"
        for fault in model.faults:
            face = fault.interface
            for point in np.flatnonzero((face.plus == node) | (face.minus == node)):
                told += f", point {face.number[point]} of fault '{fault.name}'"
        if task.error:
            told = str(task.error)
        # A point whose law failed comes first, then the largest residual.
        found = model.comm.allgather((task.error is not None, float(size.max(initial=0.0)), told))
        history = ", ".join(f"{value:.3g}" for value in self._residuals[-12:])
        reason = self._solver.reason if outer < MAX_OUTER else f"tractions still change after {outer} outer iterations"
        return ConvergenceError(
            f"no equilibrium at time {task.time:.6g} s, step of {task.dt:.4g} s: {reason} after "
            f"{len(self._residuals)} evaluations; residuals {history} N of forces of {task.scale:.3g} N; "
            f"worst: {max(found, key=lambda item: item[:2])[2]}"
        )


class _Task:
    """One step to be solved: R(u) and what goes with it.

    Attributes
    ----------
    driven : ndarray, shape (nodes * components,)
        The displacement with driven edges where they end [m].
    multipliers : dict of str to FaultState
        Fields with the tractions of the last outer iteration.
    displacement, residual, internal, responses, scale, round_off, error
        Of the last evaluation; `residual` is not a number where a law failed on this rank, which is `error`.
        `round_off` [N] is what rounding leaves of large displacements in a small residual.
    """

    def __init__(
        self, equilibrium: Equilibrium, state: State, dt: float, rates: Rates | None, load: np.ndarray, easing: float
    ) -> None:
        self._equilibrium, self._state = equilibrium, state
        self.dt, self.time, self.rates, self._load = dt, state.time + dt, rates, load
        self.driven = equilibrium.model.loads.moved(state.displacement, state.time, self.time)
        self.multipliers: dict[str, FaultState] = dict(state.faults)
        self._body = {
            fault.name: easing * equilibrium.body_stiffness(fault.interface, rates)
            for fault in equilibrium.model.faults
        }
        self.displacement = self.residual = self.internal = np.zeros(0)
        self.responses: dict[str, Response] = {}
        self.scale = self.round_off = 0.0
        self.error: ProjectionError | None = None

    @property
    def tangents(self) -> dict[str, np.ndarray]:
        return {name: response.tangent for name, response in self.responses.items()}

    def update_multipliers(self) -> None:
        """Take the last tractions; what was evaluated with others is void."""
        self.multipliers = {name: response.state for name, response in self.responses.items()}
        self.displacement = np.zeros(0)

    def evaluate(self, u: np.ndarray) -> None:
        """Collective."""
        equilibrium, model = self._equilibrium, self._equilibrium.model
        self.displacement, self.error = u.copy(), None
        elastic = -model.internal_force(u)
        parts = [elastic, self._load]
        if self.rates:
            parts.append(model.mass * self.rates.acceleration_of(u))
            parts.append(equilibrium.damping_force(self.rates.velocity_of(u)))
        self.internal = elastic.copy()
        carried = 0.0
        try:
            for fault in model.faults:
                response = self._respond(fault, u)
                self.responses[fault.name] = response
                fault.interface.assemble(response.traction, self.internal)
                area = (fault.interface.owned * fault.interface.weight)[:, None]
                carried += float(np.sum((area * _tractions(fault, response.state)) ** 2))
        except ProjectionError as error:
            self.error = error
            self.internal = np.full_like(u, np.nan)  # SNES takes a shorter step, on all ranks
        self.residual = self.internal - self._load + sum(parts[2:], np.zeros_like(u))
        driven = equilibrium._driven
        if self.error is None:
            self.residual[driven] = equilibrium.tangent.unit * (u - self.driven)[driven]
        squares = [model.owned_dot(part, part) for part in parts]
        stiff = equilibrium.tangent.diagonal * u
        *summed, stiffest = parallel.total(model.comm, [*squares, carried, model.owned_dot(stiff, stiff)])
        self.scale = float(np.sqrt(max(summed)))
        # Not more than that: a body that nothing holds flies far.
        self.round_off = min(20 * np.finfo(float).eps * float(np.sqrt(stiffest)), 1e-7 * self.scale)

    def _respond(self, fault: Fault, u: np.ndarray) -> Response:
        fields = self.multipliers[fault.name]
        return self._equilibrium._answers[fault.name](
            self._state.faults[fault.name], fault.interface.jump(u), self.dt,
            self._state.numbers.get("dt_before", 0.0), self.time,
            (fields["normal_stress"], fault.components(fields, "shear_traction")), self._body[fault.name],
        )  # fmt: skip


def _tractions(fault: Fault, fields: FaultState) -> np.ndarray:
    """Normal stress and shear tractions, shape (n, 1 + tangents) [Pa]."""
    return np.column_stack([fields["normal_stress"], fault.components(fields, "shear_traction")])
