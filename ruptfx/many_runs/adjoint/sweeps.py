"""Runs with the history of their interfaces, and tangent-linear and adjoint sweeps through it.

A step of explicit central differences, with J the jump of an interface, W the weights and P its step at points:

    f = loads - K u           v* = keep v + push (f - eta K_v v)       the motion of driven nodes is prescribed
    (change, fields) = P(J u, J v*, fields; initial tractions, parameters)
    v = v* - kick / m J' W change                u = u + dt v

The tangent-linear sweep makes the same steps with changes of all quantities. The adjoint sweep goes backward, a and b
being the factors of the objective on u and v:

    b += dt a                 (g_u, g_v, g_fields, gradient) += P'(-W J kick / m b, g_fields)
    b += J' g_v               a += J' g_u - K push b             b = keep b - eta K_v push b
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.operators import FusedOperator
from ruptfx.input.fields import component_names
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fault_step import impedances
from ruptfx.interfaces.faults.held_points import coupled_points
from ruptfx.interfaces.faults.points import Clock
from ruptfx.interfaces.mechanisms.faults import Faults
from ruptfx.laws.friction.in_fields import rate_of
from ruptfx.many_runs.adjoint.history import LARGEST
from ruptfx.many_runs.adjoint.point_map import InitialMap, PointMap
from ruptfx.many_runs.adjoint.readings import Readings
from ruptfx.many_runs.adjoint.recomputation import Moved, Recomputation
from ruptfx.platform import parallel
from ruptfx.readings.misfits import Request, Sample
from ruptfx.run.recording.schedule import end_of

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.many_runs.adjoint.bodies import ConstantChange
    from ruptfx.run.model import Model
    from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion

Floats = NDArray[np.float64]
RATE = rate_of("pore_pressure")
Told = Callable[[float, str], None]


def number_of_steps(duration: float, dt: float) -> int:
    """Return how many steps a run makes: until the interfaces have reached the duration."""
    return int(np.ceil(end_of(duration) / dt)) + 1


def diagonal_factors(motion: LeapfrogMotion) -> tuple[list[Floats], list[Floats], list[Floats]]:
    """Return keep, push and the velocity per impulse in contact at all degrees of freedom, by number of the step."""
    model, nodes = cast("Model", motion.model), motion.nodes
    every_keep, every_push, mobility = [], [], []
    for kick in nodes.kicks:
        keep = np.full(len(model.mass), kick.plain_keep)
        push = np.repeat(motion.dt * kick.plain_push, model.components)
        keep[nodes.dofs], push[nodes.dofs] = kick.keep, kick.push
        every_keep.append(keep)
        every_push.append(push)
        mobility.append(kick.clock.kick * nodes.inverse_mass(kick))
    return every_keep, every_push, mobility


def refuse_coupled_points(model: Model, mobility: Floats) -> None:
    """Check that the mass couples normal and tangential motion at no point, as `PointMap` assumes; collective.

    Raises
    ------
    CaseError
        On all ranks.
    """
    for fault in model.faults:
        face = fault.interface
        rigid = not fault.contact.traction_ends_slip
        index = coupled_points(face, mobility) if rigid else np.zeros(0, np.int64)
        error = None
        if len(index):
            x = ", ".join(f"{value:.6g}" for value in face.points[index[0]])
            error = CaseError(
                f"faults.{fault.name}.contact.kind = '{fault.contact.kind()}': no adjoint at ({x}) m, where a "
                "boundary holds a direction that is neither normal nor tangent to the interface; use "
                "contact.kind = 'compliant', or hold all directions there"
            )
        parallel.raise_on_all(model.comm, error)


class Sweeps:
    """A run that was made, and the sweeps through it.

    Parameters
    ----------
    requests : sequence of Trace or Final
        Readings of the run.
    most : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes]; what does not fit is
        computed again in every sweep.
    tell : callable
        Called with the finished fraction and a text.
    record : bool
        Whether to keep the history; without it there are readings only, and no sweeps.

    Attributes
    ----------
    model : Model
        With the contact methods of explicit steps.
    points : list of PointMap
        Of every fault.
    steps : int
    dt : float
        [s]
    samples : list of Sample
        Readings of the run.
    made : Recomputation
        The steps of the run.
    kicks : list of Kick
    clocks : list of Clock
        By number of the step.
    """

    def __init__(
        self, model: Model, requests: Callable[[Model, float, int], list[Request]], most: float = LARGEST,
        tell: Told = lambda done, text: None, record: bool = True,
    ) -> None:  # fmt: skip
        self._motion = motion = cast("LeapfrogMotion", model.case.stepper.bind(model))
        self.model, self.dt = cast("Model", motion.model), motion.dt
        self.steps = number_of_steps(model.case.duration, self.dt)
        faults = next(each for each in motion.mechanisms if isinstance(each, Faults))
        self.clocks = [Clock.of_step(self.dt, number) for number in range(3)]
        self.kicks = motion.nodes.kicks
        self._keep, self._push, self._mobility = diagonal_factors(motion)
        if record:
            refuse_coupled_points(self.model, self._mobility[-1])
        self.points = [self._point_map(motion, number) for number in range(len(self.model.faults))] if record else []
        self.readings = Readings(self.model, self.dt, self.steps, requests(self.model, self.dt, self.steps))
        self.made = Recomputation(motion, faults, self.points, self.steps, most)
        self._initial = [
            InitialMap(each.fault, list(each.parameters), each.memory, self.model.initial_slip_rate(each.fault))
            for each in self.points
        ]
        self.parameters = [np.array(list(each.parameters.values())) for each in self.points]
        self._pressures = [PressureMap(each) for each in self.points]
        self.samples = self.run_again(tell)

    def _point_map(self, motion: LeapfrogMotion, number: int) -> PointMap:
        fault = self.model.faults[number]
        items = [
            impedances(fault.interface, motion.nodes.inverse_mass(kick), kick.clock.kick) for kick in motion.nodes.kicks
        ]
        return PointMap(fault, [normal for normal, _ in items], [shear for _, shear in items])

    def run_again(self, tell: Told = lambda done, text: None) -> list[Sample]:
        """Make the run, fill the history and return the readings; collective."""

        def observe(step: int, state: State) -> None:
            self.readings.observe(step, state)
            if step:
                tell(step / self.steps, f"forward  step {step} of {self.steps}")

        self.made.run(observe)
        return self.readings.samples()

    # -- sweeps ------------------------------------------------------------------------------------------------

    def tangent(
        self, changes: list[Floats], loads: Callable[[int, float], Floats | None] = lambda fault, time: None,
        tell: Told = lambda done, text: None,
    ) -> list[Floats]:  # fmt: skip
        """Return the changes of all readings from those of the parameters; collective.

        Parameters
        ----------
        changes : list of ndarray, shape (parameters, n)
            Of every fault, in the order of `PointMap.parameters`.
        loads : callable
            Change of the shear traction that nucleations add to a fault at a time along its direction of shear [Pa],
            shape (n,).
        tell : callable
            Called with the finished fraction and a text.
        """
        size = len(self.model.mass)
        u, v = np.zeros(size), np.zeros(size)
        changes = [each.with_initial(dp) for each, dp in zip(self._pressures, changes, strict=True)]
        memory = [each.push(p, dp) for each, p, dp in zip(self._initial, self.parameters, changes, strict=True)]
        fields: dict[str, dict[str, Floats]] = {}
        self.readings.observe_change(0, u, v, fields)
        for visit in self.made.forward():
            step = visit.step
            kick, time = min(step, 2), step * self.dt
            clock = self.clocks[kick]
            v = self._keep[kick] * v + self._push[kick] * (self._stiffness(u) + self._viscous(v))
            for number, points in enumerate(self.points):
                face, row = points.fault.interface, visit.rows[number]
                parameters, dp = self.loaded(number, time), changes[number]
                if (load := loads(number, time)) is not None:
                    dp = dp.copy()
                    dp[1 : 1 + points.fault.tangents] += points.fault.shear_direction.T * load
                self._pressures[number].push(memory[number], dp, time, clock.since)
                values = np.concatenate([face.rate(u).T, face.rate(v).T, memory[number], dp])
                result = points.found(row, visit.after[number], clock)
                changed = points.push(kick, clock, row, parameters, result, values)
                local, width = points.local, len(points.memory)
                memory[number] = changed[local : local + width]
                add_jump(face, v, -self._mobility[kick], changed[:local] * face.weight)
                fields[points.fault.name] = _named(points, changed)
            u += self.dt * v
            self.readings.observe_change(step + 1, u, v, fields)
            tell((step + 1) / self.steps, f"sensitivity  step {step + 1} of {self.steps}")
        return [sample.values for sample in self.readings.samples()]

    def tangents_of_bodies(
        self, changes: Sequence[ConstantChange], tell: Told = lambda done, text: None
    ) -> list[list[Floats]]:
        """Return the changes of all readings from those of constants of the bodies, for each constant; collective.

        The run is made once more, and all constants advance beside it, because the bodies' motion is not kept.
        """
        if not changes:
            return []
        tangents = [_BodyTangent(self, each) for each in changes]
        for moved in self.made.with_bodies():
            step = moved.visit.step
            kick, time = min(step, 2), step * self.dt
            clock, result, traction = self.clocks[kick], [], []
            # The velocity before contact acts on it, hence the effect of all forces on the bodies.
            free = moved.state.velocity.copy()
            for number, points in enumerate(self.points):
                row = moved.visit.rows[number]
                result.append(points.found(row, moved.visit.after[number], clock))
                outputs = points.value(kick, clock, row, self.loaded(number, time), result[number])
                traction.append(outputs[: points.local])
                add_jump(points.fault.interface, free, self._mobility[kick],
                     traction[number] * points.fault.interface.weight)  # fmt: skip
            for each in tangents:
                each.step(moved, kick, time, free, result, traction)
            tell((step + 1) / self.steps, f"constants of bodies  step {step + 1} of {self.steps}")
        return [each.readings() for each in tangents]

    def adjoint(
        self,
        factors: list[Floats],
        each_step: Callable[[int, float, Floats], None] = lambda fault, time, result: None,
        tell: Told = lambda done, text: None,
    ) -> list[Floats]:
        """Return the factors of the parameters from those of all readings: their gradient; collective.

        Parameters
        ----------
        factors : list of ndarray
            Derivative of an objective by the values of each reading.
        each_step : callable
            Called with fault, time and the contribution of each step, shape (parameters, n).

        Returns
        -------
        list of ndarray, shape (parameters, n)
            Of every fault, in the order of `PointMap.parameters`; points of other ranks included.
        """
        seeds, dt = self.readings.seed(factors), self.dt
        fields = Backward(self._motion, self._keep, self._push)
        memory = [np.zeros((len(each.memory), each.fault.interface.weight.size)) for each in self.points]
        gradient = [np.zeros_like(each) for each in self.parameters]
        for visit in self.made.backward():
            step = visit.step
            kick, time = min(step, 2), step * dt
            clock = self.clocks[kick]
            of_outputs, named = self._empty(memory)
            for field, places, values in seeds.at(step + 1):
                fields.add(field, places, values)
            seeds.add(step + 1, named)
            fields.drift()
            for number in reversed(range(len(self.points))):
                points, of_output = self.points[number], of_outputs[number]
                face, local, row = points.fault.interface, points.local, visit.rows[number]
                of_output[:local] = -face.weight * scaled_jump(face, fields.b, self._mobility[kick]).T
                result = points.found(row, visit.after[number], clock)
                pulled = points.pull(kick, clock, row, self.loaded(number, time), result, of_output)
                width = len(points.memory)
                add_jump(face, fields.a, None, pulled[:local])
                add_jump(face, fields.b, None, pulled[local : 2 * local])
                memory[number] = pulled[2 * local : 2 * local + width]
                of_parameters = pulled[2 * local + width :]
                self._pressures[number].pull(memory[number], of_parameters, time, clock.since)
                gradient[number] += of_parameters
                each_step(number, time, of_parameters)
            if step:  # displacement and velocity at the start are given
                fields.step(kick)
            tell(1 - step / self.steps, f"backward  step {step} of {self.steps}")
        for number, initial in enumerate(self._initial):
            gradient[number] += initial.pull(self.parameters[number], memory[number])
            self._pressures[number].pull_initial(gradient[number])
        return gradient

    def _empty(self, memory: list[Floats]) -> tuple[list[Floats], dict[str, dict[str, Floats]]]:
        """Return the factors of the outputs with those that the next step has found, and views of them by field."""
        result, named = [], {}
        for points, known in zip(self.points, memory, strict=True):
            of_output = np.zeros((len(points.outputs), known.shape[1]))
            of_output[points.local : points.local + len(known)] = known
            result.append(of_output)
            named[points.fault.name] = _named(points, of_output)
        return result, named

    def loaded(self, number: int, time: float) -> Floats:
        """Return the parameters of a fault with the load of its nucleations."""
        fault, parameters = self.points[number].fault, self.parameters[number]
        if not fault.is_loaded:
            return parameters
        parameters = parameters.copy()
        parameters[1 : 1 + fault.tangents] += fault.load(time).T
        return parameters

    def factors(self, kick: int) -> tuple[Floats, Floats, Floats]:
        """Return keep, push and the velocity per impulse in contact of all degrees of freedom in a step."""
        return self._keep[kick], self._push[kick], self._mobility[kick]

    def force_of(self, displacement: Floats, velocity: Floats) -> Floats:
        """Return the force of the bodies at a motion, complete at every local node."""
        return self._stiffness(displacement) + self._viscous(velocity)

    def _stiffness(self, field: Floats) -> Floats:
        """Return -K times a field, complete at every local node."""
        return self.model.internal_force(field)

    def _viscous(self, field: Floats) -> Floats | float:
        """Return -eta K_v times a field, complete at every local node."""
        viscosity = self.model.viscosity
        if viscosity is None:
            return 0.0
        force = np.zeros_like(field)
        viscosity.operator.add_internal_force(field, force)
        self.model.layout.sum_shared(force)
        force *= viscosity.eta
        return force


class PressureMap:
    """The rate of a known pore pressure as a function of the pressure before a step and of its parameters.

    The rate is (p(t) - p_before) / dt, with p(t) from the parameters, so that the pressure of a step is p(t) whatever
    the pressure before; the first one is an initial value of the law.
    """

    def __init__(self, points: PointMap) -> None:
        self._fields = points.fault.fields
        if not self._fields:
            return
        self._names = list(points.parameters)
        self._pressure, self._rate = (points.memory.index(f"s_{name}") for name in ("pore_pressure", RATE))
        self._initial = next(
            n for n, name in enumerate(self._names) if name.startswith("p_") and name.endswith("initial_pore_pressure")
        )

    def _change(self, time: float, changes: Floats) -> Floats:
        """Return the change of the pore pressure at a time [s] by those of the parameters [Pa], shape (n,)."""
        slopes = self._fields.slopes(time).items()
        return sum((slope * changes[self._names.index(name)] for name, slope in slopes), np.zeros(changes.shape[1]))

    def with_initial(self, changes: Floats) -> Floats:
        """Return changes of the parameters with that of the initial pressure, shape (parameters, n)."""
        if not self._fields:
            return changes
        changes = changes.copy()
        changes[self._initial] += self._change(0.0, changes)
        return changes

    def push(self, memory: Floats, changes: Floats, time: float, since: float) -> None:
        """Set the change of the rate in a step that ends at a time [s], in place."""
        if self._fields:
            end = self._change(time, changes)
            memory[self._rate] = (end - memory[self._pressure]) / since if since > 0 else 0.0

    def pull(self, memory: Floats, of_parameters: Floats, time: float, since: float) -> None:
        """Move the factor of the rate to those of the pressure before and of the parameters, in place."""
        if not self._fields:
            return
        of_end = memory[self._rate] / since if since > 0 else np.zeros_like(memory[self._rate])
        memory[self._rate] = 0.0
        memory[self._pressure] -= of_end
        self._add(of_parameters, of_end, time)

    def pull_initial(self, of_parameters: Floats) -> None:
        """Add the factors by the initial pressure to those of the parameters, in place."""
        if self._fields:
            self._add(of_parameters, of_parameters[self._initial], 0.0)

    def _add(self, of_parameters: Floats, factor: Floats, time: float) -> None:
        for name, slope in self._fields.slopes(time).items():
            of_parameters[self._names.index(name)] += slope * factor


class _BodyTangent:
    """Changes of the fields of a run from that of a constant of the bodies, which advance with its steps."""

    def __init__(self, sweeps: Sweeps, change: ConstantChange) -> None:
        self._sweeps, self._change, model = sweeps, change, sweeps.model
        size = len(model.mass)
        self._u, self._v = np.zeros(size), np.zeros(size)
        self._memory = [np.zeros((len(each.memory), each.fault.interface.weight.size)) for each in sweeps.points]
        self._kicks = [change.of_kick(each) for each in sweeps.kicks]
        self._readings = Readings(model, sweeps.dt, sweeps.steps, sweeps.readings.requests)
        self._readings.observe_change(0, self._u, self._v, {})

    def step(
        self, moved: Moved, kick: int, time: float, free: Floats, items: list[Floats], traction: list[Floats]
    ) -> None:
        """Advance by a step of the run; collective.

        Parameters
        ----------
        kick : int
            Number of the step, at most 2.
        time : float
            At its beginning [s].
        free : ndarray, shape (nodes * components,)
            Velocity before contact has acted on it.
        items, traction : list of ndarray
            Slip rate and branch, and change of the traction, of every fault.
        """
        sweeps, change, u = self._sweeps, self._kicks[kick], self._u
        keep, push, mobility = sweeps.factors(kick)
        force = self._change.force(moved.displacement, moved.velocity, time) + sweeps.force_of(u, self._v)
        v = change.keep * moved.velocity + change.push * (free - keep * moved.velocity) + keep * self._v + push * force
        fields: dict[str, dict[str, Floats]] = {}
        for number, points in enumerate(sweeps.points):
            face, local = points.fault.interface, points.local
            values = np.concatenate([
                face.rate(u).T, face.rate(v).T, self._memory[number], np.zeros_like(sweeps.parameters[number]),
                change.impedances[number],
            ])  # fmt: skip
            row, parameters = moved.visit.rows[number], sweeps.loaded(number, time)
            changed = points.push(kick, sweeps.clocks[kick], row, parameters, items[number], values)
            self._memory[number] = changed[local : local + len(points.memory)]
            add_jump(face, v, -mobility, changed[:local] * face.weight)
            add_jump(face, v, -mobility * change.push, traction[number] * face.weight)
            fields[points.fault.name] = _named(points, changed)
        u += sweeps.dt * v
        self._v = v
        self._readings.observe_change(moved.visit.step + 1, u, v, fields)

    def readings(self) -> list[Floats]:
        """Return the changes of all readings; collective."""
        return [sample.values for sample in self._readings.samples()]


class Backward:
    """Factors a and b of displacement and velocity in a backward sweep.

    With D = push b and V = push a a backward step is a step of the bulk kernel, V += push (-K D) and D += dt V. So it
    advances the plain nodes, if there is no mass damping, and a and b are those of the stepped nodes only.

    Parameters
    ----------
    keep, push : list of ndarray, shape (nodes * components,)
        Of step 0, step 1, and all others.

    Attributes
    ----------
    a, b : ndarray, shape (nodes * components,)
        Valid at stepped degrees of freedom.
    """

    def __init__(self, motion: LeapfrogMotion, keep: list[Floats], push: list[Floats]) -> None:
        self._model, self._motion, self._keep, self._push = motion.model, motion, keep, push
        model, size = self._model, len(self._model.mass)
        fuses = isinstance(model.operator, FusedOperator) and all(kick.plain_keep == 1 for kick in motion.nodes.kicks)
        self._fused: FusedOperator | None = None
        self._stepped = np.ones(size, dtype=bool)
        self._dofs: NDArray[np.int64] | slice = slice(None)
        if fuses:
            stepped = np.zeros(model.nodes, dtype=bool)
            stepped[motion.nodes.dofs // model.components] = True
            if model.viscosity is not None:  # its transpose acts on b after the sweep
                stepped |= model.viscosity.nodes
            self._fused = cast("FusedOperator", copy.copy(model.operator))
            self._fused.prepare_step(stepped)
            self._stepped = np.repeat(stepped, model.components)
            self._dofs = np.flatnonzero(self._stepped)
        self.a, self.b = np.zeros(size), np.zeros(size)
        self._d, self._v = np.zeros(size), np.zeros(size)
        self._viscous = np.zeros(size)
        self._damps = any(np.any(each != 1) for each in keep)
        self._force = self._model.force.array
        self._force[:] = 0

    def add(self, field: str, places: NDArray[np.int64], values: Floats) -> None:
        """Add to the factors of `displacement` or `velocity` at some degrees of freedom, each at most once."""
        (self.a if field == "displacement" else self.b)[places] += values
        plain = ~self._stepped[places]
        at, moved = places[plain], self._push[2][places[plain]] * values[plain]
        if field == "displacement":
            self._v[at] += moved
            moved = self._motion.dt * moved  # the kernel has moved on before
        self._d[at] += moved

    def drift(self) -> None:
        """Add the factor of the displacement that a velocity has moved."""
        self.b[self._dofs] += self._motion.dt * self.a[self._dofs]

    def step(self, kick: int) -> None:
        """Go back over the change of the velocities by the bodies; collective."""
        here, model, force = self._dofs, self._model, self._force
        self._d[here] = self._push[kick][here] * self.b[here]
        if self._fused is None:
            model.operator.add_internal_force(self._d, force)
            model.force.begin()
        else:
            plain = self._motion.nodes.kicks[kick]
            how = self._d, self._v, force, plain.plain_push, self._motion.dt, plain.plain_keep
            self._fused.step(*how, part="boundary")
            model.force.begin()
            self._fused.step(*how, part="interior")
        model.force.end()
        model.loads.add_support_force(self._d, force)
        self.a[here] += force[here]
        force[here] = 0
        if self._damps:
            self.b[here] *= self._keep[kick][here]
        if (viscosity := model.viscosity) is not None:
            near = np.repeat(viscosity.nodes, model.components)
            self._viscous[near] = 0
            viscosity.operator.add_internal_force(self._d, self._viscous)
            model.layout.sum_shared(self._viscous)
            self.b[here] += viscosity.eta * self._viscous[here]
            self._viscous[:] = 0


def scaled_jump(face: Interface, field: Floats, scale: Floats) -> Floats:
    """Return J of a field times a scale of every degree of freedom, shape (n, local)."""
    c = face.frame.shape[2]
    nodal, factor = field.reshape(-1, c), scale.reshape(-1, c)
    difference = nodal[face.plus] * factor[face.plus]
    if not face.one_sided:
        difference = difference - nodal[face.minus] * factor[face.minus]
    return np.einsum("ikc,ic->ik", face.rows, difference)


def add_jump(face: Interface, field: Floats, scale: Floats | None, values: Floats) -> None:
    """Add J' values to a field in place, shape (local, n), times a scale of every degree of freedom."""
    c = face.frame.shape[2]
    vector = np.einsum("ikc,ki->ic", face.rows, values)
    nodal = field.reshape(-1, c)
    for nodes, sign in ((face.plus, 1.0), (face.minus, -1.0))[: 1 if face.one_sided else 2]:
        part = sign * vector if scale is None else sign * scale.reshape(-1, c)[nodes] * vector
        nodal[nodes] += part  # a node is at one point of an interface


def _named(points: PointMap, outputs: Floats) -> dict[str, Floats]:
    """Return views of the outputs by the field of the interface."""
    t, local = points.fault.tangents, points.local
    names = [
        *component_names("slip", t), *component_names("mean_slip_rate", t), "normal_stress",
        *points.fault.friction.all_state_fields(), *component_names("slip_rate", t),
        *component_names("shear_traction", t), "opening",
    ]  # fmt: skip
    return dict(zip(names, outputs[local:], strict=True))
