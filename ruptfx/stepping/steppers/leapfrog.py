"""Explicit central differences with a diagonal mass."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.operators import FusedOperator
from ruptfx.bodies.spectrum import springs_of, stable_time_step
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Duration, Fraction
from ruptfx.interfaces.mechanisms import Floats, mechanisms_of
from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
from ruptfx.platform import parallel
from ruptfx.stepping.steppers import Stepper

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System

    Outside = list[tuple[NDArray[np.int64] | slice, Floats]]


class Leapfrog(Stepper):
    """Central differences in leapfrog form: v(n+1/2) = v(n-1/2) + dt a(n), u(n+1) = u(n) + dt v(n+1/2).

    Second order, conserves the discrete energy exactly, stable for dt <= 2 / omega_max. Dashpots and mass damping are
    implicit, so they do not reduce the stable step.
    """

    conserving: ClassVar[dict[str, object] | None] = {}

    offers = Stepper.offers | {
        "ties",
        "stages",
        "fracture",
        "large_rotations",
        "attachments",
        "memory",
        "adjoint",
        "precision",
    }

    safety: Fraction = 0.9
    """Time step over the stable one."""
    time_step: Duration | None = None
    """Length of a step in place of the chosen one; refused if it is not stable."""

    def bind(self, model: System) -> LeapfrogMotion:
        return LeapfrogMotion(model.in_steps("explicit"), self._step_of(model))

    def fixed(self, model: System) -> Leapfrog:
        step = self._step_of(model)
        for number, stage in enumerate(model.case.stages):
            if stage.duration < (1 - 1e-6) * step:
                raise CaseError(
                    f"stages.{number}.duration = {stage.duration:.4g} s: shorter than a time step of {at_least(step)} "
                    "s; make it at least that long, or set the time_step of the stepper 'leapfrog' to "
                    f"{at_most(stage.duration)} s or less"
                )
        return self.model_copy(update={"time_step": step})

    def _step_of(self, model: System) -> float:
        stable = stable_time_step(model)
        if self.time_step is None:
            return parallel.three_digits(self.safety * stable)
        if self.time_step > stable:
            raise CaseError(
                f"stepper.time_step = {self.time_step:.4g} s: unstable, the limit is {at_most(stable)} s, "
                f"{what_limits(model, stable)}; reduce it, or leave it out"
            )
        return self.time_step


def what_limits(model: System, stable: float) -> str:
    """Return a text whether elements or springs of a mechanism limit the stable step; collective."""
    springs = springs_of(model)
    without = stable_time_step(model, []) if springs else stable
    if without < 1.05 * stable:  # within the error of the computed highest frequencies
        return "set by the elements" + " and the elastic supports of boundaries" * bool(model.loads.supports)
    first = min(springs, key=lambda each: stable_time_step(model, [each])) if len(springs) > 1 else springs[0]
    return f"set by {first.text} ({without:.4g} s without {'them' if first.plural else 'it'})"


class LeapfrogMotion:
    """Leapfrog bound to a model and a time step.

    The bulk kernel updates plain nodes where the operator supports it (`FusedOperator`), and `SteppedNodes` those
    that mechanisms act on. At the start, where displacement and velocity are known at one time, velocities
    advance by half a step first: `State.lag` is zero then.

    Attributes
    ----------
    model : System
    dt : float
        [s]
    mechanisms : list of Mechanism
    nodes : SteppedNodes

    Parameters
    ----------
    also : ndarray of bool, shape (nodes,), optional
        Further nodes that the bulk kernel leaves to `SteppedNodes`.
    """

    collective = False

    def __init__(self, model: System, dt: float, also: NDArray[np.bool_] | None = None) -> None:
        self.model, self.dt, self._kick_dt = model, dt, dt
        self.mechanisms = mechanisms = mechanisms_of(model)
        stepped = np.any([model.layout.shared, *(each.nodes() for each in mechanisms)], axis=0)
        if also is not None:
            stepped |= also
        self._fused = model.operator if isinstance(model.operator, FusedOperator) else None
        self._damped = next((each.damped for each in mechanisms if each.damped is not None), None)
        self._inelastic = next((each.inelastic for each in mechanisms if each.inelastic is not None), None)
        if self._fused:
            self._fused.prepare_step(stepped, () if self._inelastic is None else self._inelastic.sweeps)
        else:
            stepped[:] = True
        self.nodes = SteppedNodes(model, stepped, dt, any(each.rounds_as_kernel for each in mechanisms), self._damped)
        for each in mechanisms:
            each.bind(self.nodes)
        self._prepare = [each.prepare for each in mechanisms]
        self._add_first = [each.add_first for each in mechanisms]
        self._add_with_elements = [each.add_with_elements for each in mechanisms]
        self._add_internal = [each.add_internal for each in mechanisms]
        self._add_external = [each.add_external for each in mechanisms]
        self._combine = [each.combine for each in mechanisms]
        self._before_kick = [each.before_kick for each in mechanisms]
        self._after_kick = [act for each in mechanisms for act in (each.after_kick, each.exchange)]
        self._account = [each.account for each in mechanisms]
        self._started = [each.started for each in mechanisms]
        self._error: RuptfxError | None = None  # the first one of this rank in the present step
        self._sums = (-1, 0.0, 0.0)  # the last watched step, and the kinetic and strain energy of this rank after it

    def step(self, state: State) -> None:
        """Advance by one step; `state.time` becomes the time of the new displacement.

        Raises
        ------
        RuptfxError
            On the rank where a mechanism fails, once the step is complete: other ranks wait for its messages.
        """
        try:
            self._kick_and_drift(state)
        finally:
            state.step += 1
        self._raise_kept()

    def _kick_and_drift(self, state: State) -> None:
        """Let all forces act once, and move displacements and the time on by the time between kicks."""
        number = 0 if state.lag == 0 else 1 if state.numbers.pop("started", 0.0) else 2
        try:
            self._advance(state, self.nodes.kicks[number])
        finally:
            state.time += self._kick_dt
            state.numbers["lag"] = self._kick_dt
        if number == 0:
            state.numbers["started"] = 1.0
            for correct in self._started:
                correct(state, self._kick_dt)

    def _raise_kept(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _call(self, state: State, kick: Kick, *phases: list[Callable[..., None]]) -> None:
        """Call phases of all mechanisms, also after an error of this rank."""
        for phase in phases:
            for act in phase:
                try:
                    act(state, kick)
                except RuptfxError as error:
                    self._error = self._error or error

    def _advance(self, state: State, kick: Kick) -> None:
        nodes, watched = self.nodes, state.wants_energies
        stored = None if self.model.quadratic or not watched else self.model.strain_energy(state.displacement)
        plain = np.zeros(2) if watched else None
        self._call(state, kick, self._prepare, self._add_first)
        outside: Outside = [(slice(None), state.force.copy())] if watched and state.force.any() else []
        self._add_elements(state, kick, plain)
        self._call(state, kick, self._add_internal)
        internal = None
        if watched:
            internal = state.force[nodes.dofs]
            outside += [item for each in self.mechanisms for item in each.outside_energy()]
        self._call(state, kick, self._add_external, self._combine, self._before_kick)
        nodes.kick(state, kick)
        self._call(state, kick, self._after_kick, self._account)
        lost, driven = nodes.drift(state, kick)
        state.energy["damping"] += lost
        state.energy["boundary_work"] += driven
        if plain is not None and internal is not None:
            self._sum_energies(state, kick, plain, internal, outside, stored)

    def leave(self, state: State) -> None:
        """Do nothing: the state is complete after each step."""

    def enter(self, state: State) -> None:
        """Do nothing: forces are computed in each step."""

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies in the middle of the last step [J]."""
        step, *bulk = self._sums
        return self.model.energies(state, (bulk[0], bulk[1]) if state.lag and step == state.step else None)

    def _add_elements(self, state: State, kick: Kick, energy: Floats | None) -> None:
        """Add internal forces at the stepped nodes, complete over ranks; advance plain nodes in the same sweep.

        The elements at nodes of other ranks come first; their contributions are sent while the others are computed.
        """
        how = state.displacement, state.velocity, state.force, kick.plain_push, self._kick_dt, kick.plain_keep
        squares = 0.0
        if self._fused:
            squares += self._fused.step(*how, energy, self._damped, self._inelastic, "boundary")
        else:
            self.model.operator.add_internal_force(state.displacement, state.force)
        self._call(state, kick, self._add_with_elements)
        self.model.force.begin()
        if self._fused:
            squares += self._fused.step(*how, energy, self._damped, self._inelastic, "interior")
            state.energy["damping"] += kick.plain_loss * squares
        self.model.force.end()

    def _sum_energies(
        self, state: State, kick: Kick, plain: Floats, internal: Floats, outside: Outside, stored: float | None
    ) -> None:
        """Sum v' M v / 2 and u_(n+1)' K u_n / 2 of this rank from the forces of this step.

        Parameters
        ----------
        plain : ndarray, shape (2,)
            Sums of the kernel over plain nodes.
        internal : ndarray, shape (stepped degrees of freedom,)
            Internal forces [N].
        outside : list of (ndarray of int or slice, ndarray)
            Degrees of freedom and values of the forces among them that do not derive from the strain energy [N].
        stored : float, optional
            Strain energy at the previous displacement, where it is no quadratic form [J]: half a step later it is
            W(u_n) - f . v dt / 2, which is u_(n+1)' K u_n / 2 where it is one.
        """
        nodes = self.nodes
        velocity = state.velocity[nodes.index]
        over = state.displacement if stored is None else self._kick_dt * state.velocity
        kinetic = kick.plain_mass * plain[0] + (nodes.once * nodes.mass * velocity) @ velocity
        work = plain[1] + (nodes.owned * internal) @ over[nodes.index]
        for dofs, values in outside:
            work -= float(values @ over[dofs])
        self._sums = (state.step + 1, 0.5 * float(kinetic), (stored or 0.0) - 0.5 * float(work))
