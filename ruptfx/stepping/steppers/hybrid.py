"""Implicit steps for slow loading, explicit steps for ruptures."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.input.fields import component_names
from ruptfx.input.units import Duration, Speed
from ruptfx.interfaces.faults.fields import plan_fields
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.interfaces.mechanisms import StepEnd, responding
from ruptfx.interfaces.sliding.follower import FIELDS as FOLLOWED
from ruptfx.laws.contact import Way
from ruptfx.platform import parallel
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.response import FaultResponse
from ruptfx.stepping.steppers import AnyStepper, Stepper
from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion
from ruptfx.stepping.steppers.quasi_static import QuasiStaticMotion

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System

SLOW, FAST = 0.0, 1.0
RIGID = 1e6  # stiffness of rigid contact over that of the bodies, for slip from a known jump
CHECK_EVERY = 25  # explicit steps between checks of the slip rates on all ranks


class Hybrid(Stepper):
    """Runs with slow loading, ruptures and reloading.

    `slow` steps run until a point slides, or opens against cohesion, faster than `fast_above`, or until they find no
    equilibrium; then `fast` steps run until no point has been faster than `slow_below` for `calm_for`.

    A switch leaves displacement, velocity, slip and state unchanged. Two changes of energy count as damping:
    the kinetic energy of remaining waves at the switch to equilibrium, and the shift of half a step between the
    times at which the two balance energy. Every switch is in the log.
    """

    time_schemes: ClassVar[tuple[Way, ...]] = ("explicit", "implicit")
    offers = Stepper.offers | {"ties", "stages", "fracture", "attachments", "memory"}
    closure: ClassVar[float] = 1e-3
    why_open: ClassVar[str] = "explicit steps that start with slip under way balance it half a step later"
    adaptive: ClassVar[bool] = True

    slow: AnyStepper = Field(default={"kind": "quasi_static"}, validate_default=True)
    """Stepper of the loading between ruptures. It enforces rigid contact by multipliers, `fast` at split
    nodes."""
    fast: AnyStepper = Field(default={"kind": "leapfrog"}, validate_default=True)
    """Stepper of the ruptures."""
    fast_above: Speed = 1e-2
    """Slip rate above which fast steps begin."""
    slow_below: Speed = 1e-3
    """Slip rate below which slow steps resume."""
    calm_for: Duration | None = None
    """Time below `slow_below` before slow steps resume; default: ten times that of shear waves across the bodies."""

    @model_validator(mode="after")
    def _two_speeds(self) -> Hybrid:
        if self.slow_below >= self.fast_above:
            raise ValueError(f"slow_below = {self.slow_below:g}: must be less than fast_above = {self.fast_above:g}")
        if self.slow.kind() != "quasi_static":  # fixed steps would pass over a rupture
            raise ValueError(f"slow.kind = '{self.slow.kind()}': must be quasi_static, whose steps follow the slip")
        if self.fast.kind() != "leapfrog":
            raise ValueError(f"fast.kind = '{self.fast.kind()}': must be leapfrog")
        return self

    def bind(self, model: System) -> HybridMotion:
        return HybridMotion(model, self)

    def fixed(self, model: System) -> Hybrid:
        return self.model_copy(update={"fast": self.fast.fixed(model)})


class HybridMotion:
    """Steps of two kinds bound to a model.

    `State.numbers` contains the present kind, as `fast`, and the time since which no point has slid fast.
    """

    def __init__(self, model: System, stepper: Hybrid) -> None:
        self.model, self._stepper = model, stepper
        slow, fast = stepper.slow.bind(model), stepper.fast.bind(model)
        assert isinstance(slow, QuasiStaticMotion) and isinstance(fast, LeapfrogMotion)
        self._slow, self._fast = slow, fast
        self.dt = self._slow.dt
        self.collective = True
        self._calm_for = stepper.calm_for or 10 * self._crossing_time()
        self._log = logging.getLogger("ruptfx.run")

    def _crossing_time(self) -> float:
        """Return the travel time of a shear wave across all bodies at the slowest speed in any of them [s]; collective.

        No wave then remains on its way, wherever it runs.
        """
        model = self.model
        slowest = min(m.wave_speeds(model.case.plane).c_s for m in model.materials)
        high, low = (
            [parallel.largest(model.comm, (sign * axis).max(initial=-np.inf)) for axis in model.coordinates.T]
            for sign in (1, -1)
        )
        return max(a + b for a, b in zip(high, low, strict=True)) / slowest

    def step(self, state: State) -> None:
        """Make one step of the present kind, then switch if needed.

        Raises
        ------
        RuptfxError
        """
        try:
            if state.numbers.get("fast", SLOW) == FAST:
                self._step_fast(state)
            else:
                self._step_slow(state)
        finally:
            self.collective = state.numbers["fast"] == SLOW

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies of the present scheme [J]."""
        return self._under_way(state).energies(state)

    def advance_bodies(self, state: State) -> None:
        """Compute displacement and velocity that slow steps have deferred; collective."""
        self._slow.advance_bodies(state)

    def leave(self, state: State) -> None:
        self._under_way(state).leave(state)

    def enter(self, state: State) -> None:
        self._under_way(state).enter(state)

    def _under_way(self, state: State) -> QuasiStaticMotion | LeapfrogMotion:
        return self._fast if state.numbers.get("fast", SLOW) == FAST else self._slow

    def _step_slow(self, state: State) -> None:
        state.numbers["fast"] = SLOW
        bonded = {fault.name: state.faults[fault.name] for fault in self.model.faults if fault.cohesion is not None}
        before = {name: (fields["opening"].copy(), fields["damage"] < 1) for name, fields in bonded.items()}
        try:
            self._slow.step(state)
        except ConvergenceError as error:
            self._switch(state, FAST, str(error).partition(";")[0])
            self._step_fast(state)
            return
        opens = {
            name: np.where(whole, state.faults[name]["opening"] - opening, 0.0) / state.numbers["dt_before"]
            for name, (opening, whole) in before.items()
        }
        fastest = self._peak_rate(state, opens)
        if fastest > self._stepper.fast_above:
            self._switch(state, FAST, f"peak slip rate {fastest:.3g} m/s")

    def _step_fast(self, state: State) -> None:
        first = state.lag == 0
        before = _missing(self.energies(state)) if first else 0.0
        try:
            self._fast.step(state)
        finally:  # collective: a rank with an error takes part
            if first:  # explicit steps balance energy half a step later, and start from rest
                self._book(state, _missing(self.energies(state)) - before)
            if state.step % CHECK_EVERY == 0:
                self._check_calm(state)

    def _book(self, state: State, lost: float) -> None:
        """Count energy of all ranks that is lost in a switch as damping [J]."""
        if self.model.comm.rank == 0:
            state.energy["damping"] += lost / self.model.copies

    def _check_calm(self, state: State) -> None:
        """Switch back to slow steps if no point has slid or opened fast for long enough; collective."""
        opens = {}
        for fault in self.model.faults:
            if fault.cohesion is not None:
                rate, _ = fault.interface.split(fault.interface.rate(state.velocity))
                damage = state.faults[fault.name]["damage"]
                opens[fault.name] = np.where((damage > 0) & (damage < 1), rate, 0.0)
        fastest = self._peak_rate(state, opens)
        if fastest > self._stepper.slow_below:
            state.numbers["calm_since"] = state.time
        elif state.time - state.numbers["calm_since"] >= self._calm_for:
            self._switch(state, SLOW, f"peak slip rate {fastest:.3g} m/s")

    def _peak_rate(self, state: State, opens: Mapping[str, np.ndarray]) -> float:
        """Return the largest slip rate of points in contact and opening rate of cohesive points [m/s]; collective.

        Parameters
        ----------
        opens : dict of str to ndarray, shape (n,)
            Opening rate by fault with cohesion [m/s], zero where it has failed.
        """
        largest = 0.0
        for fault in self.model.faults:
            fields = state.faults[fault.name]
            speed = np.linalg.norm(fault.components(fields, "slip_rate"), axis=1)
            holds = (fields["normal_stress"] > 0) | fault.is_held
            if fault.cohesion is not None:
                holds = holds | (fields["damage"] < 1)
                largest = max(largest, float(np.abs(opens[fault.name]).max(initial=0.0)))
            largest = max(largest, float(np.where(holds, speed, 0.0).max(initial=0.0)))
        largest = max(largest, 0.0, *(mechanism.fastest(state) for mechanism in responding(self.model.mechanisms)))
        return parallel.largest(self.model.comm, largest)

    def _switch(self, state: State, to: float, why: str) -> None:
        """Switch to steps of the other kind; collective."""
        if to == FAST:
            self._slow.leave(state)
        before = _missing(self.energies(state))
        (self._bring_faults_up if to == SLOW else self._start)(state)
        state.numbers |= {"fast": to, "calm_since": state.time, "dt": self._fast.dt, "dt_before": self._fast.dt}
        state.numbers["lag"] = 0.0
        kept = {name: values for name, values in state.fields.items() if name.startswith(FOLLOWED)}
        state.fields.clear()
        state.fields |= kept
        after = self.energies(state)
        lost = _missing(after) - before
        self._book(state, lost)
        kind = (self._stepper.fast if to == FAST else self._stepper.slow).kind()
        self._log.info(
            "%s from %.9g s, step %d: %s; kinetic energy %.3g J, %.3g J booked as damping",
            kind, state.time, state.step, why, after["kinetic"], lost,
        )  # fmt: skip

    def _start(self, state: State) -> None:
        """Set mean slip rates to the present ones: explicit steps start from one time for all quantities."""
        for fault in self.model.faults:
            fields = state.faults[fault.name]
            for mean, now in zip(
                component_names("mean_slip_rate", fault.tangents), component_names("slip_rate", fault.tangents),
                strict=True,
            ):  # fmt: skip
                fields[mean][:] = fields[now]

    def _bring_faults_up(self, state: State) -> None:
        """Advance faults and attachments, whose explicit fields are one step behind, at the present displacement."""
        dt, threshold = self._fast.dt, self.model.case.output.rupture_threshold
        error = None
        end = StepEnd(state.displacement, dt)
        plan_fields(self._slow.model.faults, state, dt)
        for mechanism in self._slow.equilibrium.mechanisms:
            mechanism.advance(state, end, mechanism.respond(state, end))
        for fault, fast in zip(self._slow.model.faults, self._fast.model.faults, strict=True):
            fields, answer = state.faults[fault.name], FaultResponse(fault, threshold)
            multiplier = fields["normal_stress"], fault.components(fields, "shear_traction")
            stiffness = RIGID * self._slow.equilibrium.body_stiffness(fault.interface, None)
            try:
                jump = fault.interface.jump(state.displacement)
                new = answer(fields, jump, dt, dt, state.time, multiplier, stiffness).state
            except ProjectionError as caught:
                error = caught
                continue
            dissipated, fractured = answer.commit(state, new, dt)
            if not fast.contact.traction_ends_slip:  # both were counted until half a step after the last traction
                state.add_energy(fault.name, "frictional_dissipation", -0.5 * dissipated)
                state.energy["fracture"] -= 0.5 * fractured
        parallel.raise_on_all(self.model.comm, error)


def _missing(energies: dict[str, float]) -> float:
    """Return the supplied energy that is not in the budget [J]."""
    return 2 * energies["boundary_work"] - sum(energies.values())
