"""Equilibrium without inertia, in adaptive steps."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.input.schema import Part, unit_of
from ruptfx.input.units import Duration, Fraction, Length
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.laws.contact import Way
from ruptfx.platform import parallel
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.interface_steps import Carried, InterfaceSolution
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.steppers import Stepper
from ruptfx.stepping.steppers._slow import SlowMotion

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.solution import Solution

MOST_HALVINGS = 12
NEVER = 1e30  # length of a law that stands for none [m]
MOST_DAMAGE = 0.1  # growth of the damage of cohesion in a step
EASY, HARD = 6, 12  # Newton iterations up to which a step grows, and from which on it shrinks


class QuasiStatic(Stepper):
    """Equilibrium at the end of every step: K u + J' W (T - T_0) = F, slip and state to second order (BDF2).

    The step size follows half the difference between the explicit and the implicit Euler step, dt |V - V_old| / 2 <
    slip_tolerance + rate_tolerance dt V with V the mean slip rates of two steps, more than the error of slip, and the
    number of Newton iterations; with `strength_tolerance` also the effect of that difference on the state of the law.
    The damage of cohesion grows by at most 0.1 in a step.
    Where slip becomes unstable the next equilibrium is far away, or there is none: steps fall to `smallest_step`, jump
    to it with a message in the log, or the run stops. `radiation_damping` replaces waves (quasi-dynamic;
    Source: Rice 1993); `hybrid` computes them.
    """

    time_schemes: ClassVar[tuple[Way, ...]] = ("implicit",)
    offers = (Stepper.offers | {"ties", "stages", "fracture", "attachments", "memory"}) - {"inertia"}
    adaptive: ClassVar[bool] = True

    first_step: Duration | None = None
    """First time step; default: the fastest edge or interface moves by the slip tolerance."""
    largest_step: Duration | None = None
    """Largest time step; default: a hundredth of the duration."""
    smallest_step: Duration | None = None
    """Time step below which no step is repeated for accuracy; default: a tenth of the stable explicit one."""
    slip_tolerance: Length | None = None
    """Error of slip; default: a fiftieth of the shortest length in the friction laws, or of the slip that relaxes a
    hundredth of the normal stress over the whole interface if they have none."""
    rate_tolerance: Fraction = 0.1
    """Error of slip over the slip in a step, in addition to the slip tolerance."""
    strength_tolerance: Fraction | None = None
    """Error of the strength by the state of the law, over the normal stress: the step then follows the state,
    too, also without slip. Where errors accumulate, as in seismic cycles, about 0.001, with a slip
    tolerance of D_c / 400 and a rate tolerance of 0.02; `quasi_dynamic` needs far fewer steps there."""
    radiation_damping: bool = False
    """Subtract mu / (2 c_s) times the slip rate from the elastic traction."""
    petsc_options: PetscOptions = {}
    """Options of PETSc's solvers that replace the defaults."""

    def bind(self, model: System) -> QuasiStaticMotion:
        return QuasiStaticMotion(model.in_steps("implicit"), self)


class QuasiStaticMotion(SlowMotion["Solution"]):
    """Quasi-static steps bound to a model."""

    safety, powers, factors = 0.8, (1.0, 0.5), (0.1, 1.5)

    def __init__(self, model: System, stepper: QuasiStatic) -> None:
        super().__init__(model, stepper.radiation_damping, stepper.petsc_options)
        self._stepper = stepper
        self.slip_tolerance = stepper.slip_tolerance or self._chosen_tolerance()
        self.smallest = stepper.smallest_step or 0.1 * stable_time_step(model)
        self.greatest = stepper.largest_step or model.case.duration / 100
        self.dt = parallel.three_digits(min(stepper.first_step or self._first_step(), self.greatest))
        self._warned = False

    def _chosen_tolerance(self) -> float:
        return min((slip_to_resolve(self.model, fault) for fault in self.model.faults), default=np.inf)

    def _first_step(self) -> float:
        speeds = [self.model.case.impact_speed]
        for fault in self.model.faults:
            creep = np.linalg.norm(fault.components(fault.initial_state(), "slip_rate"), axis=1)
            speeds.append(float(creep.max(initial=0.0)))
        fastest = parallel.largest(self.model.comm, max(speeds, default=0.0))
        return self.slip_tolerance / fastest if fastest > 0 else self.greatest

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies at the end of the step [J]."""
        alone = self.equilibrium.interface_steps
        return self.model.energies(state) if alone is None else alone.energies(state)

    def advance_bodies(self, state: State) -> None:
        """Compute deferred displacement and velocity; collective."""
        if self.equilibrium.interface_steps is not None:
            self.equilibrium.interface_steps.advance_bodies(state)

    def leave(self, state: State) -> None:
        """End the deferred updates of these steps."""
        if self.equilibrium.interface_steps is not None:
            self.equilibrium.interface_steps.end(state)

    def enter(self, state: State) -> None:
        """Limit the next step to the first step of a run, as other loads may be faster."""
        state.numbers["dt"] = min(state.numbers["dt"], self.dt)

    def attempt(self, state: State, dt: float, halvings: int) -> Solution | None:
        alone = self.equilibrium.interface_steps
        if alone is not None and (carried := Carried.of(state)) is not None:
            try:
                ahead = alone.solve(state, carried, dt) if state.lazy_bodies else None
            except ConvergenceError:
                if halvings < MOST_HALVINGS and not self.equilibrium.reaches_open_points(state):
                    return None
                ahead = None
            if ahead is not None:
                return ahead
            alone.end(state)  # the full system decides whether there is an equilibrium
        try:
            return self.equilibrium.solve(state, dt, guess=state.displacement + dt * state.velocity)
        except ConvergenceError as error:
            if halvings < MOST_HALVINGS:
                return None
            advice = "slip may be unstable here: use radiation_damping = true, or kind = 'hybrid'"
            raise ConvergenceError(f"{error}; the step was halved {halvings} times, {advice}") from None

    def accepts(self, state: State, dt: float, solution: Solution, error: float) -> bool:
        if error > 1 and dt <= self.smallest:
            self._require_resolved(state, solution)
            self._warn(state, error)
        return error <= 1 or dt <= self.smallest

    def commit(self, state: State, solution: Solution) -> None:
        self.count_radiation(state, solution)
        alone = self.equilibrium.interface_steps
        if alone is not None and isinstance(solution, InterfaceSolution):
            alone.commit(state, solution)
            return
        self.take(state, solution)
        if alone is not None and state.lazy_bodies:
            alone.begin(state)

    def _require_resolved(self, state: State, solution: Solution) -> None:
        """Refuse a step in which mechanisms jump; collective.

        Raises
        ------
        ConvergenceError
            On all ranks, with an unchanged state.
        """
        errors = [mechanism.step_error(state, reaction) for mechanism, _, reaction in solution.reactions]
        error = parallel.largest(self.model.comm, max(errors, default=0.0))
        if error > 1:
            raise ConvergenceError(
                f"no equilibrium near that at time {state.time:.6g} s: the error of a step of {solution.dt:.3g} s, the "
                f"smallest, is {error:.3g} times what is tolerated; use kind = 'hybrid'"
            )

    def _warn(self, state: State, error: float) -> None:
        if not self._warned:
            logging.getLogger("ruptfx.run").warning(
                "slip runs away at %.9g s: its error is %.3g times the tolerance in steps of %.3g s, and these are the "
                "smallest; use radiation_damping = true, or kind = 'hybrid'", state.time, error, self.smallest,
            )  # fmt: skip
        self._warned = True

    def error(self, state: State, solution: Solution) -> float:
        """Return the error of slip and strength, and growth of damage, over their tolerances, largest of all points."""
        worst, dt = solution.slid, solution.dt
        for fault in self.model.faults:
            old, new = (
                fault.components(fields[fault.name], "mean_slip_rate") for fields in (state.faults, solution.faults)
            )
            speed = np.maximum(np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1))
            error = 0.5 * dt * np.linalg.norm(new - old, axis=1)
            error = error / (self.slip_tolerance + self._stepper.rate_tolerance * dt * speed)
            worst = max(worst, float(error.max(initial=0.0)))
            worst = max(worst, fault.fields.error(
                fault, state, solution.faults[fault.name], dt, self.radiation[fault.name]
            ))  # fmt: skip
            if fault.cohesion is not None:
                grown = solution.faults[fault.name]["damage"] - state.faults[fault.name]["damage"]
                worst = max(worst, float(grown.max(initial=0.0)) / MOST_DAMAGE)
            if self._stepper.strength_tolerance is not None:
                worst = max(worst, self._strength_error(fault, state, solution) / self._stepper.strength_tolerance)
        for mechanism, _, reaction in solution.reactions:
            worst = max(worst, mechanism.step_error(state, reaction))
        return parallel.largest(self.model.comm, worst)

    def _strength_error(self, fault: Fault, state: State, solution: Solution) -> float:
        """Return the estimated error of the strength over the normal stress, largest of this rank's points in contact.

        The error is half the difference between advancing the state with the slip rates of this and the previous step.
        """
        old, new, law = state.faults[fault.name], solution.faults[fault.name], fault.friction
        before, rate = (
            np.linalg.norm(fault.components(fields, name), axis=1)
            for fields, name in ((old, "mean_slip_rate"), (new, "slip_rate"))
        )
        stress, names = new["normal_stress"], law.all_state_fields()
        pressure = np.where(stress > 0, stress, 1.0)
        explicit = law.advance({name: old[name] for name in names}, before, pressure, solution.dt)
        end = {name: new[name] for name in names}
        first, last = (np.asarray(law.strength(rate, pressure, item)) for item in (explicit, end))
        error = 0.5 * np.abs(first - last) / pressure
        return float(np.max(error * (stress > 0), initial=0.0))

    def following(self, dt: float, error: float, solution: Solution) -> float:
        newton, by_error = solution.iterations / solution.outer, super().following(dt, error, solution)
        if newton <= EASY:
            return by_error
        return min(by_error, self.rounded(max(dt * self.ratio(0.7 if newton > HARD else 1.0), self.smallest)))

    def rounded(self, dt: float) -> float:
        return parallel.three_digits(dt)

    def ratio(self, factor: float) -> float:
        """Return a factor rounded down to a quarter of an octave.

        Rounding of the error, which depends on the number of ranks, then hardly ever changes the size of a step.
        """
        return float(2 ** (np.floor(4 * np.log2(factor)) / 4))


def slip_to_resolve(model: System, fault: Fault) -> float:
    """Return a fiftieth of the shortest length in the friction law [m]; collective.

    Without such a length it is a fiftieth of the slip that relaxes a hundredth of the normal stress in the softest
    place beside the interface.
    """
    shortest = -parallel.largest(model.comm, -min(_lengths(fault.friction), default=np.inf))
    if not np.isfinite(shortest):
        softest = -parallel.largest(model.comm, -sides_of(model, fault.interface).softer().min(initial=np.inf))
        length = fault.interface.line.length
        shortest = 0.01 * length * parallel.largest(model.comm, fault.normal_stress_0.max(initial=0.0)) / softest
    return 0.02 * shortest if shortest > 0 else np.inf


def _lengths(law: Part) -> Iterator[float]:
    """Yield every positive length among the parameters of a law and of the law it contains."""
    for name in type(law).model_fields:
        value = getattr(law, name)
        if isinstance(value, Part):
            yield from _lengths(value)
        elif isinstance(value, float | int | np.ndarray) and unit_of(type(law), name) == "m" and np.size(value):
            smallest = float(np.min(value))
            if 0 < smallest < NEVER:
                yield smallest
