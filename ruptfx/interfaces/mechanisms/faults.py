"""Faults whose points are pairs of opposite nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.input.fields import DERIVED, FIELDS, PRESCRIBED, Field
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import FaultStep
from ruptfx.interfaces.mechanisms import Floats, Mechanism, Rows, Springs
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.checks.table import Plan, Row
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.interfaces.sliding.step import SlidingStep


SLIDING = 0.92
"""The largest eigenvalue of compliant contact between different meshes changes with their position by up to a tenth of
its mean or, between elements of unequal size, a sixth."""


class Faults(Mechanism):
    """Friction and contact at the points of all faults, after all other forces have acted on the velocities.

    Attributes
    ----------
    steps : list of list of FaultStep
        For every kick those of all faults.
    """

    order = 60
    adjoint = local_steps = True

    def __init__(self, model: System) -> None:
        super().__init__(model)
        self.faults = self.of(model)
        self.steps: list[list[FaultStep | SlidingStep]] = []
        self._rates: list[Floats | None] = []

    @classmethod
    def of(cls, model: System) -> list[Fault]:
        """Return the faults that this mechanism handles."""
        return [fault for fault in model.faults if not fault.slides and not ties_corners(model)]

    @classmethod
    def present(cls, model: System) -> bool:
        return bool(cls.of(model))

    def begin(self, state: State) -> None:
        for fault in self.faults:
            state.faults[fault.name] = fault.initial_state(self.model.initial_slip_rate(fault))

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        half = 0.5 * state.lag
        stored = dissipated = preload = 0.0
        for fault in self.faults:
            added = half * fault.interface.rate(state.velocity)
            elastic_energy = fault.elastic_energy(state.faults[fault.name], added, half, state.fault_time)
            stored, dissipated = stored + elastic_energy[0], dissipated + elastic_energy[1]
            if fault.prescribed is not None:
                energies[PRESCRIBED] += elastic_energy[2]
            preload += fault.preload_work(state.displacement) - half * fault.preload_work(state.velocity)
        energies["interface_elastic"] += stored
        energies["frictional_dissipation"] += dissipated
        energies["boundary_work"] += preload

    def springs(self) -> list[Springs]:
        return [_contact_springs(fault, self.model.nodes) for fault in self.faults if any(fault.contact.stiffness())]

    def check(self, plan: Plan) -> Iterator[Row]:
        from ruptfx.interfaces.mechanisms.checks import fault as rows  # runs need none of it
        from ruptfx.interfaces.mechanisms.checks.holes import hole_rows

        for fault in self.faults:
            yield from hole_rows(self.model, fault)
            if len(fault.interface.plus):
                yield from rows.place_rows(self.model, fault)
                if fault.is_held.all():
                    continue  # no point rubs
                yield from rows.fault_rows(self.model, fault)
                yield from self._check_surfaces(fault, plan)
                yield from rows.rows_without_effect(self.model, fault)
                if plan.steps is not None:
                    yield from rows.shortest_time(self.model, fault, plan.dt)

    def _check_surfaces(self, fault: Fault, plan: Plan) -> Iterator[Row]:
        return iter(())

    def saved(self, state: State) -> Mapping[str, Rows]:
        entries = {}
        for fault in self.faults:
            fields = state.faults[fault.name] | state.points.get(fault.name, {})
            face = fault.interface
            entries[f"faults/{fault.name}"] = parallel.gather_fields(self.model.comm, face.number, face.owned, fields)
        return entries

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        for fault in self.faults:
            for fields in (state.faults[fault.name], state.points.get(fault.name, {})):
                for name, values in fields.items():
                    values[:] = read(f"faults/{fault.name}/{name}")[fault.interface.number]

    def recorded_fields(self) -> tuple[Field, ...]:
        """Return the fields of the points of a fault that files have, besides the state of the friction law."""
        return (*FIELDS, *DERIVED)

    def recorded(self, fault: Fault, state: State) -> FaultState:
        """Return the fields at the points of this rank, at the time of a record."""
        fields = state.faults[fault.name] | state.points.get(fault.name, {})
        face = fault.interface
        _, jump = face.split(face.jump(state.displacement) - state.lag * face.rate(state.velocity))
        return fields | dict(zip(DERIVED[0].names(fault.tangents), jump.T, strict=True))

    def nodes(self) -> NDArray[np.bool_]:
        result = super().nodes()
        for fault in self.faults:
            result[fault.interface.nodes] = True
        return result

    def bind(self, stepped: SteppedNodes) -> None:
        self.steps = []
        for kick in stepped.kicks:
            inverse_mass = stepped.inverse_mass(kick)
            self.steps.append([self._step(fault, inverse_mass, kick, stepped) for fault in self.faults])

    def _step(self, fault: Fault, inverse_mass: Floats, kick: Kick, stepped: SteppedNodes) -> FaultStep | SlidingStep:
        threshold = self.model.case.output.rupture_threshold
        return FaultStep(fault, inverse_mass, kick.clock, threshold, self.model.real)

    def before_kick(self, state: State, kick: Kick) -> None:
        steps = self.steps[kick.number]
        self._rates = [
            step.opening_rate(state.faults[step.fault.name], state.velocity, state.step == 0) for step in steps
        ]

    def after_kick(self, state: State, kick: Kick) -> None:
        for step, rate_old in zip(self.steps[kick.number], self._rates, strict=True):
            name, fields = step.fault.name, state.faults[step.fault.name]
            dissipated = step(fields, state.displacement, state.velocity, state.force, state.time)
            state.add_energy(name, "frictional_dissipation", dissipated)
            state.add_energy(name, PRESCRIBED, step.prescribed_work)
            state.energy["boundary_work"] += step.work
            state.add_energy(name, "impact_loss", step.impact_loss(fields, state.velocity, rate_old))
            state.energy["fracture"] += step.fractured(fields, state.velocity, rate_old)

    def exchange(self, state: State, kick: Kick) -> None:
        # Other ranks have nodes of single cells, but not the points at them.
        if self.model.layout.broken:
            self.model.layout.take_from_owners(state.velocity)

    def started(self, state: State, dt: float) -> None:
        # From v_0 to v in half a step the way is (v_0 + v) dt / 4; the sum over the steps has counted v dt / 2, and
        # friction v dt / 4.
        beyond = 0.25 * dt * (state.velocity - self.model.initial_velocity())
        for fault in self.faults:
            if fault.contact.traction_ends_slip:
                continue
            state.energy["boundary_work"] -= fault.preload_work(beyond)
            rate = self.model.initial_slip_rate(fault)
            if rate is not None:
                self._count_start(fault, state, 0.25 * dt * rate)

    def _count_start(self, fault: Fault, state: State, way: Floats) -> None:
        """Add the work of friction and nucleation on slip `way` [m], the uncounted part of the first half step."""
        traction = fault.components(state.faults[fault.name], "shear_traction")
        area = fault.interface.owned * fault.interface.weight
        state.add_energy(fault.name, "frictional_dissipation", float(area @ np.sum(traction * way, axis=1)))
        state.energy["boundary_work"] += float(area @ np.sum(fault.load(0.0) * way, axis=1))


def ties_corners(model: System) -> bool:
    """Return whether the corners of cells at a vertex move as one, so that no fault has nodes of its own."""
    return model.cracks is not None and model.cracks.ties_corners


def _contact_springs(fault: Fault, count: int) -> Springs:
    """Return the springs of compliant contact, at closed and stuck points."""
    face, (normal, shear) = fault.interface, fault.contact.stiffness()
    stiffness = np.array([normal] * face.has_normal + [shear] * face.tangents)
    # Surfaces may meet later: C |u+ - u-|^2 is at most 2 C (|u+|^2 + |u-|^2), and that between equal bodies.
    later = np.zeros(count)
    nodes, lengths = face.without_partner()
    later[nodes] += 2 * max(normal, shear) * lengths
    return Springs(
        f"the contact stiffness of faults.{fault.name}",
        add=lambda u, force: face.assemble(-stiffness * face.rate(u), force),
        bound=later if later.any() else None, margin=SLIDING if fault.slides else 1.0,
    )  # fmt: skip
