"""Equilibrium with radiation damping: explicit Runge-Kutta steps of slip and of the state of friction laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from ruptfx.input.fields import MONITORS, Moment
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Duration, Fraction
from ruptfx.interfaces.faults import point_step
from ruptfx.interfaces.faults.points import frictional_power
from ruptfx.interfaces.faults.projection import Resistance, StrengthAtState, solved
from ruptfx.laws.contact import Way
from ruptfx.laws.friction import AT_REST
from ruptfx.platform import parallel
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.condensed import is_condensable
from ruptfx.stepping.implicit.loaded_bodies import LoadedBodies, need_memory
from ruptfx.stepping.implicit.series_bodies import SeriesBodies, SurfaceResponses
from ruptfx.stepping.implicit.solution import Solution
from ruptfx.stepping.steppers import Stepper
from ruptfx.stepping.steppers._evolution import Evolution, evolution_of
from ruptfx.stepping.steppers._runge_kutta import attempt
from ruptfx.stepping.steppers._slow import SlowMotion

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.options import PetscOptions
    from ruptfx.stepping.implicit.receivers import Receivers
    from ruptfx.stepping.implicit.strike_series import StrikeSeries

OPENS = 0.01  # part of its initial normal stress below which a fault counts as opening
RATES_AT = "rates_at"  # time whose slip rates a state has from a step, and not from the case
SAME, ROUNDING = 1e-9, 1e-14  # relative difference of rates, and of displacements, that is none
LEAST = 1e-14  # smallest step over time, close to rounding


class Attempt(NamedTuple):
    """A step and what all points have at its end.

    Attributes
    ----------
    dt : float
        [s]
    end : ndarray, shape (points, tangents + states)
        Slip and state.
    traction : ndarray, shape (points, local)
        Beyond the initial one [Pa].
    rate : ndarray, shape (points, tangents)
        Slip rate [m/s].
    error : float
        Over the tolerance.
    """

    dt: float
    end: np.ndarray
    traction: np.ndarray
    rate: np.ndarray
    error: float


class QuasiDynamic(Stepper):
    """Quasi-dynamic equilibrium with radiation damping: adaptive Runge-Kutta steps of slip and state.

    Bodies are linear, so that a matrix computed once gives the tractions from slip:

        tau = tau_0 + tau_F(t) - K s,   ds/dt = V along tau,   dtheta/dt of the law,
        V >= 0,   strength(V, theta) + eta V >= |tau|,   V [strength(V, theta) + eta V - |tau|] = 0

    with eta the impedance of waves into both sides (Rice 1993) and theta all state variables of the law. A point
    with strength at rest sticks below it; a creeping law has none and slides at any traction. The step size follows
    the errors of slip over D_c and of ln theta, the largest of all points, or for laws with other states those of slip
    over their shortest length and of the friction coefficient; the order is five. While points slide under laws
    without a direct effect, steps are limited to a few times that of a wave across an element. `quasi_static` needs
    more steps for cycles, and handles contact that opens, attachments and bodies that are not linear.
    Source: Dormand and Prince (1980).
    """

    time_schemes: ClassVar[tuple[Way, ...]] = ("implicit",)
    offers = (Stepper.offers | {"ties", "along strike"}) - {"inertia", "sliding", "cohesion", "gap", "rigid contact"}
    adaptive: ClassVar[bool] = True

    tolerance: Fraction = 1e-4
    """Tolerance of a step: error of slip over D_c, and of ln(age) or, for other states, of the friction coefficient."""
    first_step: Duration | None = None
    """First time step; default: the step in which the fastest point slips a hundredth of its D_c."""
    largest_step: Duration | None = None
    """Largest time step; default: a hundredth of the duration."""

    def bind(self, model: System) -> QuasiDynamicMotion:
        return QuasiDynamicMotion(model, self) if model.section is None else SeriesMotion(model, self)


class QuasiDynamicMotion(SlowMotion["Attempt"]):
    """Steps bound to a model; all ranks know slip and state of all points, each evaluates the laws of its own."""

    def __init__(self, model: System, stepper: QuasiDynamic) -> None:
        super().__init__(model, True)
        self._stepper = stepper
        self._unbalanced: ConvergenceError | None = None
        self._known: np.ndarray | None = None
        self.greatest = stepper.largest_step or model.case.duration / 100
        self._shear = slice(int(model.faults[0].interface.has_normal), None)
        self._bodies = self._make_bodies()
        self._jumps = self._bodies.jumps
        self._strengths = {fault.name: StrengthAtState(fault.friction) for fault in model.faults}
        self._evolutions = {fault.name: evolution_of(model, fault) for fault in model.faults}
        self._states = max(evolution.columns for evolution in self._evolutions.values())
        self._D_c = self._of_all(lambda fault: self._evolutions[fault.name].D_c)
        self._held = self._of_all(lambda fault: fault.is_held) > 0
        self.dt = min(stepper.first_step or self._first_step(), self.greatest)

    def _make_bodies(self) -> LoadedBodies | SeriesBodies:
        if not is_condensable(self.model):
            raise CaseError(
                "stepper.kind = 'quasi_dynamic': for linear bodies with faults and without attachments; use "
                "'quasi_static'"
            )
        need_memory(self.model)
        return LoadedBodies(self.equilibrium, self._shear, self.greatest)

    def receivers(self, points: Sequence[Sequence[float]], key: str) -> Receivers:
        """Return receivers at points of the bodies [m], for messages about a key; on one rank."""
        return self._bodies.receivers(points, key)

    def _first_step(self) -> float:
        fastest = self._of_all(lambda fault: self._carried_rate(fault, fault.initial_state()))
        rate = float((fastest / self._D_c).max(initial=0.0))
        return parallel.three_digits(0.01 / rate) if rate > 0 else self.greatest

    def _initial_guess(self, fault: Fault, fields: FaultState) -> np.ndarray:
        """Return slip rates as first iterates of Newton's method [m/s], shape (n,).

        A point at rest begins at the rate of `_carried_rate`.
        """
        speed = speed_of(fault, fields)
        return np.where(speed > AT_REST, speed, self._carried_rate(fault, fields))

    def _carried_rate(self, fault: Fault, fields: FaultState) -> np.ndarray:
        """Return the slip rate at which the law carries the traction, at most that which radiates all of it [m/s]."""
        shear = size_of(fault.components(fields, "shear_traction"))
        with np.errstate(all="ignore"):
            state = {name: fields[name] for name in fault.friction.all_state_fields()}
            law = fault.friction.carried_slip_rate(shear, fields["normal_stress"], state)
            carried = np.fmin(law, shear / self.radiation[fault.name])
        return np.nan_to_num(carried, nan=0.0)

    def _of_all(self, ask: Callable[[Fault], np.ndarray]) -> np.ndarray:
        """Return values of all points from a function of each fault; collective."""
        return self._jumps.gather({fault.name: ask(fault) for fault in self.model.faults})

    def _variables(self, fault: Fault, fields: FaultState) -> np.ndarray:
        """Return the state variables of a fault, shape (n, states); zero where another fault has more of them."""
        variables = self._evolutions[fault.name].variables(fields)
        return np.pad(variables, ((0, 0), (0, self._states - variables.shape[1])))

    def begin(self, state: State) -> None:
        refuse_to_open(self.model, state)
        slip = self._of_all(lambda fault: fault.components(state.faults[fault.name], "slip"))
        variables = self._of_all(lambda fault: self._variables(fault, state.faults[fault.name]))
        self._start = np.column_stack([slip, variables])
        self._guess = self._of_all(lambda fault: self._initial_guess(fault, state.faults[fault.name]))
        # The last stage of a step is at its end, with the slopes that the next step begins with. They follow from the
        # state, so that a resumed run has the same ones.
        is_known = state.numbers.get(RATES_AT) == state.time and not any(fault.fields for fault in self.model.faults)
        self._known = None
        if is_known:
            slopes = self._of_all(
                lambda fault: known_slopes(fault, self._evolutions[fault.name], state.faults[fault.name], self._states)
            )
            self._known = slopes if np.isfinite(slopes).all() else None  # the first stage names the point

    def longest(self, state: State, planned: float) -> float:
        return planned

    def error(self, state: State, result: Attempt) -> float:
        return result.error

    def accepts(self, state: State, dt: float, result: Attempt, error: float) -> bool:
        shorter = self.scaled(dt, error, self.powers[0])
        if error > 1 and shorter < LEAST * (state.time + self.greatest):
            raise ConvergenceError(
                f"no step is short enough at time {state.time:.9g} s, down to {shorter:.3g} s; use stepper.kind = "
                "'quasi_static'"
            )
        return error <= 1

    def commit(self, state: State, result: Attempt) -> None:
        solution = self._solution(state, result)
        self.count_radiation(state, solution)
        self.take(state, solution)
        state.numbers[RATES_AT] = state.time

    def attempt(self, state: State, dt: float, halvings: int) -> Attempt:
        time = state.time
        for fault in self.model.faults:
            self._evolutions[fault.name].begin(state, dt)
        loaded, later = self._bodies.loaded_jump(time), self._bodies.loaded_jump(time + dt)
        # Loads are linear in time over a step, and so are the tractions without slip.
        growth, held, more = (later - loaded) / dt, self._bodies.held(loaded), self._bodies.held(later - loaded)

        def slope(part: float, y: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
            slopes, *answer = self._slope(time + part * dt, held + part * more, growth, y)
            if part == 0 and not np.isfinite(slopes).all():  # no step is short enough
                parallel.raise_on_all(self.model.comm, self._unbalanced)
            return slopes, (answer[0], answer[1])

        shear, moved = self._start.shape[1] - self._states, self._bodies.prescribed
        known, rounding = self._known, ROUNDING * float(np.abs(later[moved]).max(initial=0.0)) / dt
        if known is not None and not np.allclose(known[moved, :shear], growth[moved, self._shear], SAME, rounding):
            known = None  # driven edges have another rate than in the step before
        y, wrong, answer = attempt(slope, self._start, dt, known)
        if self._held.any():  # what the stages have missed of a history is an error of the step
            slip = y[:, :shear].copy()
            self._follow(time + dt, y)
            wrong[:, :shear] = np.where(self._held[:, None], np.abs(y[:, :shear] - slip), wrong[:, :shear])
        wrong[:, :shear] /= self._D_c[:, None]
        wrong[:, shear:] = self._of_all(lambda fault: self._errors(fault, time + dt, y, wrong, *answer))
        error = float(parallel.agreed(self.model.comm, wrong.max(initial=0.0))) / self._stepper.tolerance
        return Attempt(dt, parallel.agreed(self.model.comm, y), *answer, error if np.isfinite(error) else np.inf)

    def _follow(self, time: float, y: np.ndarray) -> None:
        """Set the prescribed slip of a time in slip and state of all points; collective."""
        if self._held.any():
            nothing = np.zeros((1, y.shape[1] - self._states))
            slip = self._of_all(lambda fault: nothing + (
                np.zeros((len(fault.is_held), 1)) if fault.prescribed is None else fault.prescribed.slip(time)
            ))  # fmt: skip
            y[:, : slip.shape[1]] = np.where(self._held[:, None], slip, y[:, : slip.shape[1]])

    def _errors(
        self, fault: Fault, time: float, y: np.ndarray, wrong: np.ndarray, traction: np.ndarray, rate: np.ndarray
    ) -> np.ndarray:
        """Return relative errors of the state variables of a fault, shape (n, states), from those of all points."""
        shear, evolution = y.shape[1] - self._states, self._evolutions[fault.name]
        end, off, traction, rate = (self._jumps.pick(each, fault.name) for each in (y, wrong, traction, rate))
        entries = slice(shear, shear + evolution.columns)
        pressure, _ = stresses(fault, time, traction)
        errors = evolution.errors(end[:, entries], off[:, entries], size_of(rate), pressure)
        return np.pad(errors, ((0, 0), (0, self._states - evolution.columns)))

    def _slope(
        self, time: float, held: np.ndarray, growth: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rates of slip and state, tractions beyond the initial ones, and slip rates of all points.

        Shapes (points, tangents + states), (points, local) and (points, tangents); NaN without a rate, or on opening.
        """
        shear, y = y.shape[1] - self._states, y.copy() if self._held.any() else y
        self._follow(time, y)
        traction = parallel.agreed(self.model.comm, self._bodies.traction(held, y[:, :shear]))
        result, self._unbalanced = {}, None
        with np.errstate(all="ignore"):  # trial steps that are too long
            for fault in self.model.faults:
                fields = (y[:, shear:], traction, growth, self._guess, self._bodies.prescribed)
                result[fault.name] = self._answer(fault, time, *(self._jumps.pick(each, fault.name) for each in fields))
        columns = self._jumps.gather(result)
        rate, ageing, traction = np.split(columns, np.cumsum([shear, self._states]), axis=1)
        speed = size_of(rate)
        self._guess = np.where(np.isfinite(speed), speed, self._guess)
        return np.concatenate([rate, ageing], axis=1), traction, rate

    def _answer(
        self, fault: Fault, time: float, variables: np.ndarray, traction: np.ndarray, growth: np.ndarray,
        guess: np.ndarray, prescribed: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Return slip rate, rates of the state variables and traction of the points of one fault, in columns."""
        evolution, eta, strength = self._evolutions[fault.name], self.radiation[fault.name], self._strengths[fault.name]
        state, traction = evolution.state(variables[:, : evolution.columns]), traction.copy()
        pressure, shear = stresses(fault, time, traction)
        size = size_of(shear)

        # Radiation is the same in all directions: one scalar equation for |tau| of the points that friction moves.
        rows = np.flatnonzero(~(prescribed | fault.is_held))
        of_rows, pressed = size[rows], pressure[rows]
        trial = point_step.shifted_trial([of_rows], [eta[rows]], [np.zeros_like(of_rows)], 1.0)

        def resistance(rate: np.ndarray) -> Resistance:
            return *strength(rate, pressed, state, rows), rate  # the law sees V itself

        speed = np.zeros_like(size)
        speed[rows] = np.where(pressed > 0, solved(trial, pressed, pressed, pressed > 0, resistance, guess[rows]).rate,
                               np.nan)  # fmt: skip
        wrong = np.flatnonzero(np.isnan(speed))
        if len(wrong):
            values = {
                "shear traction": size, "normal stress": pressure,
                "strength at rest": strength(0 * size, pressure, state)[0],
                "strength at the slip rate that radiates all traction": strength(size / eta, pressure, state)[0],
            }  # fmt: skip
            self._unbalanced = unbalanced(fault, time, wrong[0], values)
        rate = speed[:, None] * shear / np.where(size > 0, size, 1.0)[:, None]
        if fault.prescribed is not None:
            rate = np.where(fault.is_held[:, None], fault.prescribed.rate(time), rate)
            speed = size_of(rate)
        if prescribed.any():
            # Slip follows the bodies there, and friction gives the traction.
            rate = np.where(prescribed[:, None], growth[:, self._shear], rate)
            speed = size_of(rate)
            at = np.flatnonzero(prescribed)
            carried = strength(speed[at], pressure[at], state, at)[0] + eta[at] * speed[at]
            carried = (carried / np.where(speed[at] > 0, speed[at], 1.0))[:, None] * rate[at]
            traction[at, self._shear] = carried - fault.driving_shear(time)[at]
        changing = evolution.rates(state, np.maximum(speed, AT_REST), pressure)
        unused = np.zeros((len(speed), self._states - evolution.columns))
        return np.column_stack([rate, changing, unused, traction])

    def _solution(self, state: State, result: Attempt) -> Solution:
        dt, end, traction, rate, _ = result
        model, jumps, time = self.model, self._jumps, state.time + dt
        moved = model.loads.moved(state.displacement, state.time, time)
        u, internal = self._bodies.displacement(moved, time, end[:, : end.shape[1] - self._states], traction)
        faults = {}
        for fault in model.faults:
            items = (jumps.pick(each, fault.name) for each in (end, traction, rate))
            faults[fault.name] = self._fields(fault, state, dt, *items)
        return Solution(u, internal, faults, dt, 0, 1, [], 0.0, self.equilibrium.answers)

    def _fields(
        self, fault: Fault, state: State, dt: float, end: np.ndarray, traction: np.ndarray, rate: np.ndarray
    ) -> FaultState:
        """Return the fields of one fault at the end of a step."""
        old, time = state.faults[fault.name], state.time + dt
        pressure, shear = stresses(fault, time, traction)
        shear_columns, evolution = end.shape[1] - self._states, self._evolutions[fault.name]
        slip, variables = end[:, :shear_columns], end[:, shear_columns : shear_columns + evolution.columns]
        new = fault.state_of({
            "normal_stress": pressure, "opening": np.zeros(len(slip)), "slip": slip, "slip_rate": rate,
            "mean_slip_rate": (slip - fault.components(old, "slip")) / dt, "shear_traction": shear,
        }) | evolution.state(variables)  # fmt: skip
        at = Moment(
            time=time, since=dt, speed=size_of(rate), speed_then=speed_of(fault, old),
            normal_stress=pressure, normal_stress_then=old["normal_stress"], closed=(pressure > 0) | fault.is_held,
            held=fault.is_held,
            has_strength=fault.has_strength, power=frictional_power(fault, old, new, dt), duration=dt,
            threshold=fault.threshold_at(time, self.model.case.output.rupture_threshold),
        )  # fmt: skip
        return new | {monitor.name: np.asarray(monitor.update(old[monitor.name], at)) for monitor in MONITORS}


class SeriesMotion(QuasiDynamicMotion):
    """Steps of surfaces in bodies that repeat along strike; displacements are those of the interfaces alone."""

    _bodies: SeriesBodies

    @property
    def series(self) -> StrikeSeries:
        """Matrices of the wavenumbers."""
        return self._bodies.series

    def _make_equilibrium(self, petsc_options: PetscOptions | None) -> SurfaceResponses:  # type: ignore[override]
        return SurfaceResponses(self.model, self.radiation)

    def _make_bodies(self) -> SeriesBodies:
        return SeriesBodies(self.equilibrium.model, self.greatest)

    def energies(self, state: State) -> dict[str, float]:
        strain = self._bodies.strain_energy(state.time, *self._slip_and_change(state.faults, state.time))
        return self.model.energies(state, (0.0, strain if self.model.comm.rank == 0 else 0.0))

    def _slip_and_change(self, faults: Mapping[str, FaultState], time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return slip [m] and T - T_0 [Pa] of all points; collective."""

        def change(fault: Fault) -> np.ndarray:
            fields = faults[fault.name]
            normal = fault.normal_stress_0 - fields["normal_stress"]
            return np.column_stack([normal, fault.components(fields, "shear_traction") - fault.driving_shear(time)])

        return self._of_all(lambda fault: fault.components(faults[fault.name], "slip")), self._of_all(change)

    def _account(self, state: State, solution: Solution) -> np.ndarray:
        times = state.time, state.time + solution.dt
        ends = [self._slip_and_change(*end) for end in zip((state.faults, solution.faults), times, strict=True)]
        slips, tractions = zip(*ends, strict=True)
        if self.model.comm.rank == 0:
            state.energy["boundary_work"] += self._bodies.work(times, slips, tractions)
        return np.zeros_like(state.velocity)


def known_slopes(fault: Fault, evolution: Evolution, fields: FaultState, states: int) -> np.ndarray:
    """Return rates of slip and of state variables of a fault in a state, shape (n, tangents + states)."""
    rate = fault.components(fields, "slip_rate")
    state = evolution.state(evolution.variables(fields))
    changing = evolution.rates(state, np.maximum(size_of(rate), AT_REST), fields["normal_stress"])
    return np.column_stack([rate, changing, np.zeros((len(rate), states - evolution.columns))])


def speed_of(fault: Fault, fields: FaultState) -> np.ndarray:
    """Return the slip rate [m/s], shape (n,)."""
    return size_of(fault.components(fields, "slip_rate"))


def size_of(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors, shape (n,); for two components a third of the time of NumPy's norm."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def refuse_to_open(model: System, state: State) -> None:
    """Refuse a state in which a fault opens; collective.

    Raises
    ------
    ConvergenceError
    """
    for fault in model.faults:
        opens = (state.faults[fault.name]["normal_stress"] < OPENS * fault.normal_stress_0) & ~fault.is_held
        if parallel.anywhere(model.comm, bool(opens.any())):
            raise ConvergenceError(
                f"faults.{fault.name} opens at time {state.time:.9g} s: less than {OPENS:.0%} of its initial "
                "normal stress is left; use stepper.kind = 'quasi_static'"
            )


def stresses(fault: Fault, time: float, traction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return normal stress and shear traction [Pa], shapes (n,) and (n, tangents), from changes of traction."""
    pressure = fault.normal_stress_0 - (traction[:, 0] if fault.interface.has_normal else 0.0)
    return pressure, fault.driving_shear(time) + traction[:, int(fault.interface.has_normal) :]


def unbalanced(fault: Fault, time: float, point: int, values: dict[str, np.ndarray]) -> ConvergenceError:
    """Return the error for a point without a slip rate."""
    where = ", ".join(f"{x:.6g}" for x in fault.interface.points[point])
    listed = ", ".join(f"{name} {value[point]:.6g} Pa" for name, value in values.items())
    return ConvergenceError(
        f"no slip rate solves |shear traction| = strength + eta V at point {fault.interface.number[point]} of "
        f"fault '{fault.name}' at ({where}) m, time {time:.9g} s: {listed}; check faults.{fault.name}.friction, or "
        "use stepper.kind = 'quasi_static'"
    )
