"""Equilibrium at the end of an implicit step: one nonlinear solve for the displacement, shared by implicit steppers.

    R(u) = M a(u) + C v(u) + eta K_v v(u) + K u + J' W (T(u) - T_0) - F = 0

with a = c_M (u - u*) and v = v* + c_C (u - u*), Newmark's rules (`Rates`), or without them in
quasi-static steps. T(u) is the traction at the end of the step from contact method and shared projection
for the jump of u, with the state of the friction law advanced inside, and its exact tangent (`response`).
Driven edges are Dirichlet conditions.

    equilibrium = Equilibrium(model, petsc_options)
    solution = equilibrium.solve(state, dt)              # quasi-static: to state.time + dt
    solution = equilibrium.solve(state, dt, Rates(...))  # dynamic
    solution.commit(state)                               # optional: `state` is unchanged before

`solve` raises `ConvergenceError` on all ranks without a change of the state, so that a step can be halved and tried
again. `commit` sets displacement and fault fields, counts the dissipation of faults and the work of nucleation,
and advances `state.time` and `state.step`; the stepper updates velocity and other quantities of its scheme.

Contact methods with multipliers (`augmented_lagrangian`) are solved in outer iterations: the tractions of the last
solution are the multipliers of the next, until they converge. At the end of a step multipliers and tractions are
the same, so that the state and checkpoints contain them.

Linear bodies allow steps to be solved on the interfaces only (`condensed`); the full system is solved by PETSc's
SNES (Newton with line search) and KSP (`solvers`) if bodies are not linear, if it is large, if the case has PETSc
options, or if the iteration on interfaces with open points fails. Its matrix is factorised again only after a change of
the step or of the tangent of an interface. The options override the defaults:
``petsc_options = { snes_monitor = true, ksp_type = "fgmres" }``; an unused option is an error. `snes_rtol` bounds the
norm of R over that of the forces in it (`Solution.scale`), `snes_atol` is in newton.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.state import State
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fields import plan_fields
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.mechanisms import responding
from ruptfx.interfaces.sliding.follower import StepFollower
from ruptfx.platform import parallel
from ruptfx.stepping.implicit import ConvergenceError, interface_steps, preconditioners
from ruptfx.stepping.implicit.compliance import norm
from ruptfx.stepping.implicit.condensed import Condensed, fits, require_fit
from ruptfx.stepping.implicit.forces import Forces
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.implicit.response import FaultResponse
from ruptfx.stepping.implicit.solution import Rates, Solution
from ruptfx.stepping.implicit.solvers import NewtonSolver
from ruptfx.stepping.implicit.step import MAX_OUTER, Step, Terms

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System

# Factors of the penalty of multipliers, tried in turn until Newton's iteration converges: the larger the
# penalty, the fewer outer iterations, but the harder each of them.
EASINGS = (1.0, 0.1, 0.01)
# The pairing is updated until the pressure changes by at most this part of the largest, at most this many times.
SETTLED, MOST_FACINGS = 1e-4, 10


class Equilibrium(Terms):
    """Solver for the displacement at the end of a step.

    Parameters
    ----------
    model : System
    petsc_options : dict, optional
        PETSc options without dash and prefix: snes_..., ksp_..., pc_..., mat_....
    radiation : dict of str to float or ndarray, optional
        Impedance [Pa s/m] of waves that are not computed, by fault; see `FaultResponse`.
    condensed : bool
        Solve on the interfaces only, where possible and without options of the case.

    Attributes
    ----------
    interface_steps : InterfaceSteps, optional
        Solves quasi-static steps without the bodies, which are updated when output needs them.

    Raises
    ------
    CaseError
        A contact method for explicit steps only.
    RuptfxError
        Levels of multigrid that do not fit into the memory.
    """

    def __init__(
        self, model: System, petsc_options: PetscOptions | None = None,
        radiation: Mapping[str, np.ndarray | float] | None = None, condensed: bool = True,
    ) -> None:  # fmt: skip
        self.model = model = model.in_steps("implicit")
        threshold = model.case.output.rupture_threshold
        self.answers = {f.name: FaultResponse(f, threshold, (radiation or {}).get(f.name, 0.0)) for f in model.faults}
        multipliers = any(fault.contact.multiplier_tolerance() is not None for fault in model.faults)
        self.easings = EASINGS if multipliers else (1.0,)
        self._owned = model.owned_nodes * model.components
        self.driven = model.loads.prescribed
        self.forces = Forces(model)
        self.preconditioner = preconditioners.choose(model, petsc_options or {})
        preconditioners.need_memory(model, self.preconditioner)
        self.tangent = self.preconditioner.make_tangent(model, self.forces.dashpot)
        self.mechanisms = responding(model.mechanisms)
        self._followers = [StepFollower(model, fault) for fault in model.faults if fault.slides]
        if self._followers:
            if petsc_options:
                raise CaseError(
                    f"stepper.petsc_options: faults.{self._followers[0].name} slides, and steps are then solved at the "
                    "interfaces, not by PETSc; remove them"
                )
            require_fit(model)
        full_system = bool(petsc_options) or not condensed or not fits(model)
        self._solver: Condensed | NewtonSolver = (
            NewtonSolver(model, self.tangent, self.preconditioner, petsc_options or {})
            if full_system
            else Condensed(model, self.tangent)
        )
        self.interface_steps: interface_steps.InterfaceSteps | None = None
        if isinstance(self._solver, Condensed) and interface_steps.fits(model):
            self.interface_steps = interface_steps.InterfaceSteps(self, self._solver)

    def begin(self, state: State) -> None:
        """Set the pairing of sliding interfaces to that of a state, before its forces are computed."""
        for follower in self._followers:
            follower.begin(state)

    def solve(
        self,
        state: State,
        dt: float,
        rates: Rates | None = None,
        added: np.ndarray | float = 0.0,
        guess: np.ndarray | None = None,
    ) -> Solution:
        """Return the equilibrium at state.time + dt, with `state` unchanged; collective.

        Parameters
        ----------
        state : State
            State at the beginning of the step.
        dt : float
            Length of the step [s].
        rates : Rates, optional
            Without it only friction depends on velocity: quasi-static.
        added : ndarray, shape (nodes * components,)
            Force added to F [N], e.g. from the last step of the scheme.
        guess : ndarray, shape (nodes * components,), optional
            Initial displacement of the iteration at free nodes; default: the present one.

        Raises
        ------
        ConvergenceError
            On all ranks: no convergence, with the history of the residual and the worst point.
        CaseError
            On all ranks: unused PETSc options.
        """
        plan_fields(self.model.faults, state, dt)
        load = self.forces.load(state.time + dt) + added
        u = (state.displacement if guess is None else guess).copy()
        if not self._followers:
            return self._solve(state, dt, rates, load, u)
        self.begin(state)
        begun = self.forces.internal(state)
        try:
            solution = self._follow(state, dt, rates, load, u)
            solution.begun = begun
            return solution
        except ConvergenceError:
            self.begin(state)
            raise

    def _follow(self, state: State, dt: float, rates: Rates | None, load: np.ndarray, u: np.ndarray) -> Solution:
        """Solve with updates of the pairing until it is that of the solution; collective."""
        changes: list[float] = []
        solution, followers = None, self._followers
        self._everywhere(lambda follower: follower.at(u))
        while solution is None or changes[-1] > SETTLED:
            if len(changes) == MOST_FACINGS:
                data = ", ".join(f"{change:.2g}" for change in changes)
                raise ConvergenceError(
                    f"no equilibrium at time {state.time + dt:.6g} s, step of {dt:.4g} s: what the points of "
                    f"faults.{followers[0].name} face goes on changing, by {data} of the largest pressure, {SETTLED:g} "
                    "is small enough"
                )
            solution = self._solve(state, dt, rates, load, u, solution)
            u = solution.displacement
            stresses = {f.name: np.abs(solution.faults[f.name]["normal_stress"]) for f in followers}
            largest = {name: parallel.largest(self.model.comm, s.max(initial=0.0)) for name, s in stresses.items()}
            changes.append(self._everywhere(partial(self._change, solution, rates, largest)))
        slid = self._everywhere(StepFollower.slid)
        if slid > 1:
            raise ConvergenceError(
                f"the step of {dt:.4g} s to {state.time + dt:.6g} s slides {slid:.3g} times as far as "
                f"faults.{followers[0].name}.sliding.limit allows"
            )
        solution.pairing_changes, solution.slid, solution.followers = changes, slid, followers
        return solution

    def _change(
        self, solution: Solution, rates: Rates | None, largest: Mapping[str, float], follower: StepFollower
    ) -> float:
        stiffness, name = self.body_stiffness(follower.face, rates), follower.name
        return follower.change(solution.displacement, solution.faults[name], stiffness, largest[name])

    def _solve(
        self, state: State, dt: float, rates: Rates | None, load: np.ndarray, guess: np.ndarray,
        last: Solution | None = None,
    ) -> Solution:  # fmt: skip
        """Solve with the present pairing, from a displacement and the tractions of the last solution."""
        residuals: list[float] = []
        iterations, solver = 0, self._solver
        times = 2 if self.reaches_open_points(state) else 1
        for number, easing in enumerate(times * self.easings):
            if number == len(self.easings):
                logging.getLogger("ruptfx.run").info(
                    "no equilibrium at the interfaces alone at %.9g s, step of %.3g s (%s): solved with the whole "
                    "bodies", state.time + dt, dt, solver.reason,
                )  # fmt: skip
                solver = self._fallback
            step = Step(self, state, dt, rates, load, easing)
            if last is not None:
                step.multipliers = last.faults
            u = guess.copy()
            u[self.driven] = step.driven[self.driven]
            outer = 0
            while outer < MAX_OUTER:
                converged = solver.solve(step, u)
                outer += solver.outer
                iterations += solver.iterations
                residuals += solver.history
                if not converged:
                    break
                u = step.displacement
                if step.multipliers_converged():
                    faults = {name: response.state for name, response in step.responses.items()}
                    return Solution(
                        u, step.internal, faults, dt, iterations, outer, residuals, step.scale, self.answers,
                        reactions=step.reactions,
                    )  # fmt: skip
                step.update_multipliers()
        raise self._failure(step, solver, outer, residuals)

    def reaches_open_points(self, state: State) -> bool:
        """Return whether a failed iteration at the interfaces is repeated with the whole bodies; collective.

        While points open and close, the line search at the interfaces can stall where that of the whole system does
        not. Closed interfaces without equilibrium have none in the whole system either.
        """
        if self._followers or not isinstance(self._solver, Condensed):
            return False
        is_open = any(bool(np.any(fields["opening"] > 0)) for fields in state.faults.values())
        return parallel.anywhere(self.model.comm, is_open)

    @cached_property
    def _fallback(self) -> NewtonSolver:
        """Solver of the whole bodies, for steps in which the iteration at the interfaces fails."""
        return NewtonSolver(self.model, self.tangent, self.preconditioner, {})

    def answer(self, state: State, dt: float, u: np.ndarray) -> Solution:
        """Return the response of bodies and faults after `dt` to any displacement, balanced or not; collective.

        Raises
        ------
        ProjectionError
            On all ranks: an interface without an admissible traction.
        """
        plan_fields(self.model.faults, state, dt)
        step = Step(self, state, dt, None, np.zeros_like(u), 1.0)
        step.evaluate(u)
        parallel.raise_on_all(self.model.comm, step.error)
        faults = {name: response.state for name, response in step.responses.items()}
        return Solution(u.copy(), step.internal, faults, dt, 0, 0, [], step.scale, self.answers, step.tangents,
                        reactions=step.reactions)  # fmt: skip

    def _everywhere(self, action: Callable[[StepFollower], float | None]) -> float:
        """Call a function for all sliding interfaces and return its largest result; collective.

        Raises
        ------
        ConvergenceError
            On all ranks: surfaces that fold back at the trial displacement.
        """
        results, error = [0.0], None
        for follower in self._followers:
            try:
                results.append(action(follower) or 0.0)
            except RuptfxError as caught:
                error = ConvergenceError(str(caught))
        parallel.raise_on_all(self.model.comm, error)
        return parallel.largest(self.model.comm, max(results))

    def body_stiffness(self, interface: Interface, rates: Rates | None) -> np.ndarray:
        """Return the diagonal of K and inertia over the area of every point, of its softer side [Pa/m]."""
        inertia = self.model.layout.reduce_tied(self.model.mass)
        diagonal, mass = (each.reshape(self.model.nodes, -1) for each in (self.tangent.diagonal, inertia))
        c_M = rates.mass if rates else 0.0
        sides = ((diagonal[side] + c_M * mass[side]).max(axis=1) for side in (interface.plus, interface.minus))
        return np.asarray(np.minimum(*sides) / interface.weight)

    def rounding(self, displacement: np.ndarray) -> float:
        """Return the norm of unbalanced forces by rounding of a displacement [N]; collective."""
        return 100 * float(np.finfo(float).eps) * norm(self.model, self.tangent.diagonal * displacement)

    def _failure(
        self, step: Step, solver: Condensed | NewtonSolver, outer: int, residuals: list[float]
    ) -> ConvergenceError:
        """Return the message of a failed solution; collective."""
        model = self.model
        size = np.abs(step.residual[: self._owned])
        size = np.where(np.isfinite(size), size, np.inf)
        worst = int(np.argmax(size)) if len(size) else 0
        node = worst // model.components
        place = "(" + ", ".join(f"{value:.6g}" for value in model.coordinates[node]) + ") m"
        for fault in model.faults:
            face = fault.interface
            for point in np.flatnonzero((face.plus == node) | (face.minus == node)):
                place += f", point {face.number[point]} of fault '{fault.name}'"
        if step.error:
            place = str(step.error)
        # A point whose law failed comes first, then the largest residual.
        result = model.comm.allgather((step.error is not None, float(size.max(initial=0.0)), place))
        history = ", ".join(f"{value:.3g}" for value in residuals[-12:])
        reason = solver.reason if outer < MAX_OUTER else f"tractions still change after {outer} outer iterations"
        return ConvergenceError(
            f"no equilibrium at time {step.time:.6g} s, step of {step.dt:.4g} s: {reason} after "
            f"{len(residuals)} evaluations; residuals {history} N of forces of {step.scale:.3g} N; "
            f"worst: {max(result, key=lambda item: item[:2])[2]}"
        )
