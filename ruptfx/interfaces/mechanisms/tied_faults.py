"""Faults with rigid contact on bodies whose corners move together: tractions that depend on which corners these are."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.interfaces.cracks.rigid import RigidCracks
from ruptfx.interfaces.faults.coupled_step import CoupledStep
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.mechanisms import Mechanism
from ruptfx.interfaces.mechanisms.fault_forces import FaultForces
from ruptfx.interfaces.mechanisms.faults import Faults, ties_corners
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System

LOG = logging.getLogger("ruptfx.run")
EXTRAPOLATED = 0.4
"""Part of the change of the tractions in a sweep that is added to them before the next sweep. The change decreases by
0.5 to 0.6 per sweep, and by 0.7 to 0.8 without it."""
REPORTED = (1, 10, 100, 1000, 10_000)  # numbers of steps without convergence at which the log reports it


class TiedFaults(FaultForces):
    """Faults whose tractions follow from the velocities, beside facets that tie the corners of cells.

    The points at a vertex share the components of tied corners on both sides. Their tractions, and those of the
    inserted facets that end at the vertex, are computed in sweeps until they converge: all points of the faults at
    once, then the facets of every vertex with several components. The first sweep begins with the tractions of the
    previous step. Where both components carry no other point, or points with equal tractions, one sweep is exact.

    Attributes
    ----------
    unconverged : int
        Steps that ended without convergence after the largest number of sweeps.
    """

    order = 95

    def __init__(self, model: System) -> None:
        super().__init__(model)
        assert isinstance(model.cracks, RigidCracks)
        self._rigid, self.unconverged = model.cracks, 0
        self._couplings: list[list[CoupledStep]] = []

    @classmethod
    def of(cls, model: System) -> list[Fault]:
        tied = ties_corners(model)
        return [fault for fault in model.faults if tied and not fault.slides and not fault.contact.traction_ends_slip]

    def bind(self, stepped: SteppedNodes) -> None:
        self._stepped = stepped
        count, threshold = len(stepped.dofs), self.model.case.output.rupture_threshold
        self._couplings = [
            [CoupledStep(fault, count, kick.clock, threshold) for fault in self.faults] for kick in stepped.kicks
        ]
        self.steps = [[*steps] for steps in self._couplings]
        limits = [fault.contact.sweeps_to() for fault in self.faults]
        self._tolerance = min(limit[0] for limit in limits if limit)
        self._most = max(limit[1] for limit in limits if limit)
        self._change = np.zeros(count)
        self._rigid.components_changed = True
        # A rank may have cells at a vertex of a fault whose points other ranks have.
        at_points = np.zeros((self.model.nodes, 2))
        at_points[np.concatenate([fault.interface.nodes for fault in self.faults])] = 1
        self.model.layout.take_from_owners(at_points.ravel())
        self._rigid.couple(np.flatnonzero(at_points[:, 0]))

    def prepare(self, state: State, kick: Kick) -> None:
        # All ranks together: facets are inserted on all that touch them, but perhaps not on the others.
        if not parallel.anywhere(self.model.comm, self._rigid.components_changed):
            return
        self._rigid.components_changed = False
        corners = self._rigid.corners_at(self._rigid.coupling)
        self._dofs = (2 * corners[:, None] + np.arange(2)).ravel()
        weight = np.zeros(len(self._change))
        for fault in self.faults:
            face = fault.interface
            for side in (face.plus, face.minus):
                np.add.at(weight.reshape(-1, 2), side, face.weight[:, None])
        self._sum(weight)
        for each, steps in zip(self._stepped.kicks, self._couplings, strict=True):
            mobility = (weight * each.push / each.clock.kick).reshape(-1, 2)
            for step in steps:
                step.put_mobility(mobility)

    def _sum(self, values: NDArray[np.float64]) -> None:
        """Sum values at the nodes that ranks own over the components at faults, for all their corners; collective."""
        self.model.layout.take_from_owners(values)
        self._rigid.total(values, values, self._rigid.coupling)

    def add_first(self, state: State, kick: Kick) -> None:
        for step in self._couplings[kick.number]:
            step.begin(state.faults[step.fault.name], state.force, state.time)

    def exchange(self, state: State, kick: Kick) -> None:
        """Compute the tractions at all points and at the facets that end there.

        Raises
        ------
        ProjectionError
            On the rank of a point without an admissible traction.
        """
        rigid, dofs, steps = self._rigid, self._dofs, self._couplings[kick.number]
        facets = rigid.ends_at(rigid.coupled)
        begun = {name: state.cracks[name][facets] for name in rigid.fields_of_ends}
        velocity, force = state.velocity[dofs], state.force[dofs]
        error: RuptfxError | None = None
        converged = False
        for number in range(self._most):
            self._hold(state, kick, np.zeros(5))
            self._change[:] = 0
            try:
                for step in steps:
                    step.sweep(
                        state.faults[step.fault.name], state.displacement, state.velocity, self._change, state.time
                    )
            except RuptfxError as caught:
                error = caught
            change, scale = np.max(self.model.comm.allgather([
                np.inf if error else max(step.change for step in steps), max(step.scale for step in steps)
            ]), axis=0)  # fmt: skip
            converged = change <= self._tolerance * scale
            last = converged or number == self._most - 1 or change == np.inf
            if number and not last:
                for step in steps:
                    step.extrapolate(self._change, EXTRAPOLATED)
            self._sum(self._change)
            velocity += kick.push[dofs] * self._change[dofs]
            force += self._change[dofs]
            state.velocity[dofs], state.force[dofs] = velocity, force
            for name, values in begun.items():
                state.cracks[name][facets] = values
            if last:
                break
        self._hold(state, kick, rigid.losses)
        if error is not None:
            raise error
        if not converged:
            self._report(state.time)
        self._count(state, steps)

    def _hold(self, state: State, kick: Kick, losses: NDArray[np.float64]) -> None:
        """Add the tractions of the facets that end at the faults; collective."""
        clock = kick.clock
        self._rigid.hold(
            state, clock.dt, clock.kick, clock.since, kick.push, self._stepped.velocity_before, self._rigid.coupled,
            losses,
        )  # fmt: skip
        self.model.layout.take_from_owners(state.velocity)

    def _count(self, state: State, steps: list[CoupledStep]) -> None:
        """Add the work and the losses of the step."""
        for step, rate_old in zip(steps, self._rates, strict=True):
            name, fields = step.fault.name, state.faults[step.fault.name]
            state.add_energy(name, "frictional_dissipation", step.finish(
                fields, self._stepped.velocity_before, state.velocity, state.time
            ))  # fmt: skip
            state.energy["boundary_work"] += step.work
            state.add_energy(name, "impact_loss", step.impact_loss(fields, state.velocity, rate_old))
            state.energy["fracture"] += step.fractured(fields, state.velocity, rate_old)

    def _report(self, time: float) -> None:
        """Log some of the steps whose tractions have not converged."""
        self.unconverged += 1
        if self.unconverged in REPORTED and self.model.comm.rank == 0:
            LOG.warning(
                "faults: tractions beside inserted facets did not converge within contact.sweeps = %d, step %d of that "
                "kind, at %.6g s; the run goes on with what they are, which a larger contact.tolerance allows",
                self._most, self.unconverged, time,
            )  # fmt: skip

    before_kick = Faults.before_kick
    after_kick = Mechanism.after_kick
    started = Faults.started
