"""The explicit step of an interface that slides: the step of every point, repeated until neighbours agree.

Neighbouring points share the nodes they face, so that the traction of one changes the jump of the other. The compiled
step of a fault (`ruptfx.fault_step`) does not know: it is given jumps instead of displacements, and the diagonal of
J M^-1 J' instead of inverse masses. Compliant contact needs the jump of the displacement alone, and one such step.
Rigid contact is solved in sweeps (`ContactMethod.sweeps`): all points at once, from the velocities that the tractions
of the last sweep leave, from the state at the beginning of the step. It is a Jacobi iteration, the same for any
partition; the first sweep begins with the tractions of the step before.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ruptfx.fault import Fault
from ruptfx.fault_step import FaultStep
from ruptfx.interface import Interface
from ruptfx.points import Clock
from ruptfx.sliding.interface import SlidingInterface
from ruptfx.sliding.surface import Floats
from ruptfx.state import FaultState

LOG = logging.getLogger("ruptfx.run")
REPORTED = (1, 10, 100, 1000, 10_000)  # numbers of steps that did not settle at which the log says so


class SlidingStep:
    """What `FaultStep` is for interfaces whose points are pairs of nodes: the same parameters, `work` and call.

    Attributes
    ----------
    unsettled : int
        Steps that ended with the last sweep that is allowed.
    """

    def __init__(self, fault: Fault, inverse_mass: Floats, clock: Clock, threshold: float) -> None:
        face = fault.interface
        assert isinstance(face, SlidingInterface)
        self.fault, self.clock, self._face = fault, clock, face
        self.work, self.unsettled = 0.0, 0
        self._sweeps = fault.contact.sweeps_to()
        n = len(face.plus)
        self._inverse_mass = inverse_mass[face.dofs]
        self._mobility, self._revision = np.ones(2 * n), -1
        each = np.arange(n)
        points = Interface(
            face.points, face.position, face.number, each, each, np.tile(np.eye(2), (n, 1, 1)), face.weight, face.owned,
            face.total, face.line, other_side="rigid",
        )  # fmt: skip
        # Nucleation is left out of the points and added here, to the tractions that they start from.
        self._points = FaultStep(replace(fault, interface=points, nucleation=()), self._mobility, clock, threshold)
        self._jump, self._rate, self._unused = np.zeros(2 * n), np.zeros(2 * n), np.zeros(2 * n)
        # The initial stress of the bodies acts on the nodes where it acted at the start, wherever they slide.
        initial = np.zeros_like(inverse_mass)
        face.initial.assemble(np.column_stack([-fault.normal_stress_0, fault.shear_traction_0]), initial)
        self._initial_force = initial[face.dofs]
        self._rate_before = np.zeros((n, 2))

    def opening_rate(self, state: FaultState, velocity: Floats) -> Floats | None:
        """Opening rate of every point before the step [m/s]; None where contact is compliant and nothing collides."""
        if self._sweeps is None:
            return None
        self._rate_before = self._face.rate(velocity)
        return self._rate_before[:, 0]

    def impact_loss(self, state: FaultState, velocity: Floats, rate_old: Floats | None) -> float:
        """Work of the normal stress over a step, points of this rank [J].

        It is that of plastic impacts, and what follows from frozen operators.
        """
        if rate_old is None:
            return 0.0
        power = self.fault.contact.lost_in_impact(state["normal_stress"], rate_old, self._face.rate(velocity)[:, 0])
        return self._sum(power) * self.clock.kick

    def __call__(self, state: FaultState, displacement: Floats, velocity: Floats, force: Floats, time: float) -> float:
        """Advance `state`, `velocity` and `force` in place; returns the energy dissipated on this rank [J].

        Raises
        ------
        ProjectionError
            A point without an admissible traction; `state` and `velocity` are then of no use.
        """
        face, fault, kick = self._face, self.fault, self.clock.kick
        if not len(face.plus):
            return 0.0
        if self._revision != face.geometry.revision:
            rows = face.geometry.jump
            self._mobility[:] = rows.multiply(rows) @ self._inverse_mass
            # What faces nothing carries nothing, whatever its impedance.
            own = self._inverse_mass[: 2 * len(face.plus)].reshape(-1, 2)[~face.covered]
            self._mobility.reshape(-1, 2)[~face.covered] = np.where(own > 0, own, 1.0)
            self._points.refresh()
            self._revision = face.geometry.revision
        self._jump[:] = face.jump(displacement).ravel()
        load = fault.load(time)
        if self._sweeps is None:
            self._points.start_from(fault.normal_stress_0, fault.driving_shear(time))
            dissipated = self._points(state, self._jump, self._rate, self._unused, time)
            pull = self._pull(state, load)
        else:
            pull = self._solve(state, velocity[face.dofs], load, time, *self._sweeps)
        velocity[face.dofs] += kick * self._inverse_mass * pull
        force[face.dofs] += pull
        if self._sweeps is not None:
            dissipated = self._taken(state["shear_traction"], state["shear_traction"], state, velocity)
        if fault.is_loaded:
            self.work = self._taken(fault.load(time - self.clock.since), load, state, velocity)
        return dissipated

    def _solve(
        self, state: FaultState, velocity: Floats, load: Floats, time: float, tolerance: float, most: int
    ) -> Floats:
        """Tractions of all points in sweeps; the nodal force of the last ones on the degrees of freedom of the face."""
        begun = {name: values.copy() for name, values in state.items()}
        scale = self.clock.kick * self._inverse_mass
        pull = self._pull(state, load)
        for sweep in range(most):
            last = {name: state[name].copy() for name in ("normal_stress", "shear_traction")}
            if sweep:
                for name, values in begun.items():
                    state[name][:] = values
            self._points.start_from(last["normal_stress"], last["shear_traction"][:, None])
            self._rate[:] = self._face.geometry.jump @ (velocity + scale * pull)
            self._points(state, self._jump, self._rate, self._unused, time)
            pull = self._pull(state, load)
            change = max(np.abs(state[name] - values).max() for name, values in last.items())
            if change <= tolerance * max(np.abs(state[name]).max() for name in last):
                return pull
        self.unsettled += 1
        if self.unsettled in REPORTED:
            LOG.warning(
                "faults.%s: tractions did not settle within contact.sweeps = %d, step %d of that kind, at %.6g s; the "
                "run goes on with what they are, which a larger contact.tolerance allows", self.fault.name, most,
                self.unsettled, time,
            )  # fmt: skip
        return pull

    def _pull(self, state: FaultState, load: Floats) -> Floats:
        """Force of the tractions on the degrees of freedom of both surfaces [N]."""
        traction = np.column_stack([-state["normal_stress"], state["shear_traction"] - load])
        weighted = (self._face.weight[:, None] * traction).ravel()
        pull: Floats = self._initial_force - self._face.geometry.jump.T @ weighted
        return pull

    def _taken(self, traction_old: Floats, traction: Floats, state: FaultState, velocity: Floats) -> float:
        """Work of a shear traction over the step, points of this rank [J].

        In sweeps on the jump of the velocities, so that the budget closes however well they have settled.
        """
        if self._sweeps is None:
            before = rate = state["mean_slip_rate"]
            length = self.clock.since
        else:
            before, rate = self._rate_before[:, 1], self._face.rate(velocity)[:, 1]
            length = self.clock.kick
        return self._sum(self.fault.contact.dissipated(traction_old, traction, before, rate)) * length

    def _sum(self, power: Floats) -> float:
        return float(self._face.owned @ (self._face.weight * power))
