"""Steps of PETSc's TS, with schemes chosen by PETSc options."""

from __future__ import annotations

import logging
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.input.quantities import at_most
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Duration, Positive
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.laws.contact import Way
from ruptfx.platform import fem, parallel
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.implicit.preconditioners import BELOW
from ruptfx.stepping.implicit.preconditioners.lu import KeptFactors
from ruptfx.stepping.implicit.solvers import MORE_FILL, TOLERANCE, CaseOptions
from ruptfx.stepping.implicit.step import FAR
from ruptfx.stepping.steppers import Stepper

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.solution import Solution


LOG = logging.getLogger("ruptfx.run")
SAME = 1e-9  # of a step: rounding of times
MOST_FAILURES = 30  # linear solutions of a step with factors that are too old


class PetscTs(Stepper):
    """Schemes of PETSc's TS: TSALPHA2 (implicit), TSBASICSYMPLECTIC or TSRK (explicit).

    Tractions of faults are computed at the time of a stage, with the state advanced from the beginning of
    the step as if it ended at the stage, and are committed when a step is accepted; a rejected step changes
    nothing. Friction is of second order in time for every scheme. `petsc_options` apply to TS, its SNES and KSP:
    ``{ ts_rk_type = "5dp", ts_adapt_type = "basic" }``, ``ts_alpha_radius``, ``ts_monitor``; steps vary only with an
    adaptor, and every attempt that TS rejects is in the log; without one a step of another length is an error.
    TS makes one step at a time and monitors run after each, so that recorder, checkpoints and
    signals work as for all steppers. Explicit native steps (`leapfrog`) are many times faster. After a restart
    `alpha2` computes its acceleration again, so that results agree to the order of the scheme, not bitwise.
    """

    time_schemes: ClassVar[tuple[Way, ...]] = ("implicit",)
    second_order: ClassVar[bool] = False
    closure: ClassVar[float] = 0.01
    why_open: ClassVar[str] = "its schemes damp, and work is summed from the ends of steps"
    offers = (Stepper.offers | {"attachments"}) - {"sliding", "cohesion", "multipliers", "newmark"}

    scheme: Literal["alpha2", "basicsymplectic", "rk"] = "alpha2"
    """Family of PETSc's schemes."""
    time_step: Duration | None = None
    """Length of a step; default: from `courant`."""
    courant: Positive | None = None
    """Time step over the stable explicit one, without `time_step`; default: 2.5 for `alpha2`, else 0.5."""
    petsc_options: PetscOptions = {}
    """Options of PETSc's TS and solvers."""

    def bind(self, model: System) -> PetscTsMotion:
        model = model.in_steps("implicit")
        damped = bool(np.any(model.loads.dashpot)) or model.case.damping.mass > 0 or model.viscosity is not None
        if self.scheme == "basicsymplectic" and parallel.anywhere(model.comm, damped):
            raise CaseError(
                "stepper.scheme = 'basicsymplectic': forces must not depend on velocity; use 'rk' or 'alpha2'"
            )
        kind = str(self.petsc_options.get("ts_basicsymplectic_type", "2"))
        if self.scheme == "basicsymplectic" and kind not in ("1", "2"):
            raise CaseError(
                f"stepper.petsc_options.ts_basicsymplectic_type = '{kind}': its stages go back in time, friction "
                "cannot; use '1', '2', or scheme = 'rk'"
            )
        courant = self.courant or (2.5 if self.scheme == "alpha2" else 0.5)
        return PetscTsMotion(model, self, self.time_step or parallel.three_digits(courant * stable_time_step(model)))


class PetscTsMotion:
    """TS bound to a model; the size of the next step is `state.numbers["dt"]`."""

    collective = True

    def __init__(self, model: System, stepper: PetscTs, dt: float) -> None:
        self.model, self.dt, self._scheme = model, dt, stepper.scheme
        self._equilibrium = Equilibrium(model, stepper.petsc_options)
        self._owned = model.owned_nodes * model.components
        self._ghosted = fem.dolfinx.fem.Function(model.space)
        self._driven = model.loads.prescribed
        self._state: State
        self._error: ProjectionError | None = None
        self._last: tuple[float, np.ndarray, Solution] | None = None  # the solution at a time and a displacement
        self._scale = 0.0  # of the last forces [N]
        self._ready = False
        # The residual grows in the first Newton step where sliding begins, and a line search would not allow that.
        defaults: PetscOptions = {
            "ts_adapt_type": "none", "ts_basicsymplectic_type": "2", "snes_linesearch_type": "basic",
            **MORE_FILL, **self._equilibrium.preconditioner.defaults,
        }  # fmt: skip
        self._adapts = stepper.petsc_options.get("ts_adapt_type", "none") != "none"
        self._rejected = 0  # steps so far
        self._options = CaseOptions(stepper.petsc_options, defaults)
        PETSc: Any = fem.PETSc
        self._ts = PETSc.TS().create(model.comm)
        self._ts.setOptionsPrefix(self._options.prefix)
        self._ts.setType(stepper.scheme)
        self._ts.setExactFinalTime(PETSc.TS.ExactFinalTime.STEPOVER)
        self._ts.setMaxTime(1e300)
        self._ts.setMaxSteps(2**31 - 2)
        self._ts.setErrorIfStepFails(False)
        if stepper.scheme == "alpha2":
            self._set_up_second_order()
        else:
            self._set_up_first_order(PETSc)

    def _set_up_second_order(self) -> None:
        """Set the residual F(t, u, v, a) = 0 and its Jacobian."""
        matrix = self._equilibrium.tangent.matrix
        self._unit = self._mean_mass()  # times this mass, rows a = a_D of driven edges are as large as the others
        self._u, self._v = matrix.createVecRight(), matrix.createVecRight()
        self._ts.setI2Function(fem.callback(self._residual), matrix.createVecLeft())
        self._kept = KeptFactors.of(matrix, self._equilibrium.preconditioner, self._options.given)
        factored = matrix if self._kept is None else self._kept.factored
        self._ts.setI2Jacobian(fem.callback(self._jacobian), matrix, factored)
        self._ts.setSolution2(self._u, self._v)
        # Without an adaptor TS would go on with a quarter of the step for ever.
        self._ts.setMaxSNESFailures(-1 if self._adapts else 1)
        snes = self._ts.getSNES()
        snes.setTolerances(rtol=TOLERANCE, atol=0.0, stol=1e-14, max_it=30)
        snes.setConvergenceTest(fem.callback(self._converged))
        self._equilibrium.preconditioner.set_up(snes.getKSP(), self.model, self._equilibrium.tangent)
        if self._kept is not None:
            self._kept.set_up(snes.getKSP())
            snes.setMaxLinearSolveFailures(MOST_FAILURES)  # the next iteration makes new factors

    def _mean_mass(self) -> float:
        total = parallel.total(self.model.comm, self.model.mass[: self._owned].sum())
        return float(total) / (self.model.total_nodes * self.model.components)

    def _set_up_first_order(self, PETSc: Any) -> None:
        """Set d(u, v)/dt = (v, a(t, u, v)), whole or in the two parts of symplectic schemes."""
        n, comm = self._owned, self.model.comm
        self._both = PETSc.Vec().createMPI((2 * n, None), comm=comm)
        self._u, self._v = None, None
        if self._scheme == "rk":
            self._ts.setRHSFunction(fem.callback(self._rates), self._both.duplicate())
        else:
            first = self._both.getOwnershipRange()[0]
            for name, offset, function in (("position", 0, self._velocity), ("momentum", n, self._acceleration)):
                part = PETSc.IS().createStride(n, first=first + offset, step=1, comm=comm)
                self._ts.setRHSSplitIS(name, part)
                rates = PETSc.Vec().createMPI((n, None), comm=comm)
                self._ts.setRHSSplitRHSFunction(name, fem.callback(function), rates)
        self._ts.setSolution(self._both)

    # -- what TS asks for --------------------------------------------------------------------------------------------

    def _spread(self, owned: np.ndarray) -> np.ndarray:
        """Return local values with ghosts, a copy, from owned ones; collective."""
        self._ghosted.x.array[: self._owned] = owned
        self._ghosted.x.scatter_forward()
        return self._ghosted.x.array.copy()

    def _answer(self, time: float, u: np.ndarray) -> Solution | None:
        """Return the solution of faults and bodies at a stage, None where a law fails; collective.

        The error of the law is stored. The Jacobian is asked for where the residual was.
        """
        last = self._last
        is_new = last is None or last[0] != time or not np.array_equal(last[1], u)
        if is_new or self.model.comm.size > 1:  # ranks must agree
            try:
                self._last = time, u.copy(), self._equilibrium.answer(self._state, time - self._state.time, u)
            except ProjectionError as error:
                self._error, self._last = error, None
                return None
        assert self._last is not None
        solution = self._last[2]
        self._scale = solution.scale
        return solution

    def _balance(self, time: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return internal and damping forces less the load [N]; not a number where a law fails."""
        if time - self._state.time < 1e-9 * self.dt:
            internal = self._equilibrium.forces.internal(self._state)
        else:
            solution = self._answer(time, u)
            internal = np.full_like(u, np.nan) if solution is None else solution.internal
        return internal + self._equilibrium.forces.damping_force(v) - self._equilibrium.forces.load(time)

    def _accelerated(self, time: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return a(t, u, v) [m/s2]."""
        a = -self._balance(time, u, v) / self.model.mass
        self.model.loads.accelerate(a, time)
        return a

    def _residual(self, _: object, time: float, *vectors: fem.PETSc.Vec) -> None:
        u, v, a = (self._spread(vector.array_r) for vector in vectors[:3])
        force = self.model.mass * a + self._balance(time, u, v)
        wanted = np.zeros_like(a)
        self.model.loads.accelerate(wanted, time)
        force[self._driven] = self._unit * (a - wanted)[self._driven]
        vectors[3].array[:] = force[: self._owned]

    def _jacobian(
        self, _: object, time: float, u: fem.PETSc.Vec, v: object, a: object, c_C: float, c_M: float, *matrices: object
    ) -> None:
        solution = self._answer(time, self._spread(u.array_r))
        if solution is None:
            return  # the residual is not a number either, and SNES gives up
        reactions = [reaction for _, _, reaction in solution.reactions]
        symmetric = self._equilibrium.tangent.update(
            c_M, c_C, solution.tangents, driven=c_M * self._unit, reactions=reactions
        )
        ksp = self._ts.getSNES().getKSP()
        enough = TOLERANCE * self._scale
        self._equilibrium.preconditioner.follow(ksp, symmetric, self._options.given, enough)
        if self._kept is not None:
            self._kept.follow(ksp, BELOW * enough)

    def _converged(self, snes: fem.PETSc.SNES, _: int, norms: tuple[float, float, float]) -> int | None:
        """Test the residual against the forces, which balance before anything moves, and the update."""
        rtol, atol, stol, _ = snes.getTolerances()
        moved, step, residual = norms
        reasons = fem.PETSc.SNES.ConvergedReason
        if residual <= max(rtol * self._scale, atol):
            return reasons.CONVERGED_FNORM_RELATIVE
        return reasons.CONVERGED_SNORM_RELATIVE if 0 < step < stol * moved else None

    def _velocity(self, _: object, __: float, v: fem.PETSc.Vec, out: fem.PETSc.Vec) -> None:
        out.array[:] = v.array_r

    def _acceleration(self, ts: fem.PETSc.TS, _: float, u: fem.PETSc.Vec, out: fem.PETSc.Vec) -> None:
        # TS passes the time of the step, not that of the stage: positions are those of its beginning or of its end.
        displacement = self._spread(u.array_r)
        ends = parallel.anywhere(self.model.comm, not np.array_equal(displacement, self._state.displacement))
        time = self._state.time + (self._ts.getTimeStep() if ends else 0.0)
        out.array[:] = self._accelerated(time, displacement, np.zeros_like(displacement))[: self._owned]

    def _rates(self, ts: fem.PETSc.TS, time: float, both: fem.PETSc.Vec, out: fem.PETSc.Vec) -> None:
        u, v = self._spread(both.array_r[: self._owned]), self._spread(both.array_r[self._owned :])
        a = self._accelerated(time, u, v)
        out.array[:] = np.concatenate([v[: self._owned], a[: self._owned]])

    # -- steps -------------------------------------------------------------------------------------------------------

    def step(self, state: State) -> None:
        """Make one step of TS, with the size that its adaptor and solver allow; collective.

        Raises
        ------
        ConvergenceError
            On all ranks: TS failed; the state is that of the last accepted step.
        """
        self._state, self._last, ts = state, None, self._ts
        equilibrium = self._equilibrium
        carried = equilibrium.forces.carried(state)
        self._put(state)
        ts.setTime(state.time)
        planned = state.numbers.get("dt", self.dt)
        ts.setTimeStep(planned)
        self._error = None
        with nullcontext() if self._ready else self._options:
            if not self._ready:
                ts.setFromOptions()
                ts.setUp()
            elif self._scheme == "rk":
                ts.restartStep()  # driven edges were put where they belong: no stage of the last step can be used again
            ts.step()
        if not self._ready and self._options.unread:
            raise CaseError(
                f"{self._options.unread}: TS of type {ts.getType()} has no such option; correct or remove it"
            )
        self._ready = True
        dt = ts.getTime() - state.time
        self._report_rejected(state.time, planned, dt)
        solution = (
            self._answer(ts.getTime(), self._taken(state, dt)) if dt > 0 and ts.getConvergedReason() >= 0 else None
        )
        if solution is None or not np.isfinite(solution.scale):
            raise ConvergenceError(
                f"TS ({ts.getType()}) found no step of {planned:.4g} s from time {state.time:.6g} s: reason "
                f"{ts.getConvergedReason()}" + (f"; {self._error}" if self._error else "; reduce stepper.time_step")
            )
        if not self._adapts and abs(dt - planned) > SAME * planned:
            raise ConvergenceError(
                f"TS ({ts.getType()}) made a step of {dt:.4g} s from time {state.time:.6g} s, and {planned:.4g} s "
                "was asked "
                f"for: use stepper.time_step = {at_most(dt)}, or allow steps to vary, petsc_options.ts_adapt_type "
                "= 'basic'"
            )
        if self._scheme == "alpha2":  # SNES may end at a short step, and options may let it end without a test
            residual = float(ts.getSNES().getFunctionNorm())
            allowed = max(FAR * solution.scale, equilibrium.rounding(solution.displacement))
            if not residual <= allowed:
                raise ConvergenceError(
                    f"TS ({ts.getType()}) left {residual:.3g} N out of balance at time {ts.getTime():.6g} s, "
                    f"{allowed:.3g} N is allowed: reduce stepper.time_step, or remove stepper.petsc_options of snes "
                    "and ksp"
                )
        velocity = self._new_velocity(ts.getTime())
        equilibrium.forces.count_work(state, solution, velocity, carried)
        state.velocity[:] = velocity
        solution.commit(state)
        state.numbers["dt"] = ts.getTimeStep()
        ts.monitor(state.step, state.time, self._both if self._scheme != "alpha2" else self._u)

    def _report_rejected(self, time: float, planned: float, dt: float) -> None:
        """Log the attempts at a step that TS rejected."""
        rejected = self._ts.getStepRejections() + self._ts.getSNESFailures()
        if rejected > self._rejected and dt > 0 and self.model.comm.rank == 0:
            LOG.warning(
                "TS rejected %d attempts at a step of %.4g s from %.9g s, and made one of %.4g s (%d rejected so far)",
                rejected - self._rejected, planned, time, dt, rejected,
            )  # fmt: skip
        self._rejected = rejected

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies at the end of the last step [J]."""
        return self.model.energies(state)

    def _put(self, state: State) -> None:
        """Copy the state to TS, with the velocity of driven edges."""
        velocity = state.velocity.copy()
        self.model.loads.drive(velocity, state.time)
        n = self._owned
        if self._scheme == "alpha2":
            self._u.array[:], self._v.array[:] = state.displacement[:n], velocity[:n]
        else:
            self._both.array[:] = np.concatenate([state.displacement[:n], velocity[:n]])

    def _taken(self, state: State, dt: float) -> np.ndarray:
        """Return the displacement of TS after its step, with driven edges at their prescribed position [m]."""
        u = self._spread(self._u.array_r if self._scheme == "alpha2" else self._both.array_r[: self._owned])
        return np.where(self._driven, self.model.loads.moved(state.displacement, state.time, state.time + dt), u)

    def _new_velocity(self, time: float) -> np.ndarray:
        v = self._spread(self._v.array_r if self._scheme == "alpha2" else self._both.array_r[self._owned :])
        self.model.loads.drive(v, time)
        return v
