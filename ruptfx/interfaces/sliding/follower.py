"""Updates of the pairing of a sliding interface, and their data for restarts."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.state import FaultState, State
from ruptfx.input.fields import component_names
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.points import Clock, closed_and_stuck
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.interfaces.sliding.surface import Floats, Integers, Surface

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation

LOG = logging.getLogger("ruptfx.run")
LARGE = 0.05  # strain or rotation of a facet, an estimate of the error of the theory of small strains
FIELDS = "followed_"  # prefix of the names of nodal fields in a state
BARELY = 1e-9  # overlap by rounding over the distance of nodes


class Follower:
    """Updates the geometry of an interface after motion; called at the beginning of every explicit step.

    The state contains the data of the last update, the displacement as a nodal field and the tangential jump as a field
    of the fault: a restart from a checkpoint has bitwise the same geometry.

    Parameters
    ----------
    fault : Fault
        Its interface slides.
    """

    def __init__(self, fault: Fault) -> None:
        face = fault.interface
        assert isinstance(face, SlidingInterface)
        self._fault, self.face = fault, face
        self._made: State | None = None  # the state that the geometry belongs to
        self._room = 0.0  # lower bound of the slip until the next update [m]
        self._followed = np.zeros(0)  # displacement of the last update at the nodes of both sides [m]
        self._cohesion = fault.traced_cohesion()
        self._large = LARGE  # threshold of the next warning

    def __call__(self, state: State) -> None:
        """Update the pairing if a point has slid far enough, or if one without a partner may find one."""
        face, geometry = self.face, self.face.geometry
        self._room -= geometry.slides
        geometry.slides = np.inf
        is_current = self._made is state and self._room > 0  # no point has slid far enough
        if is_current and geometry.all_covered:
            return
        _, slip_then = self._recall(state)
        if not len(face.plus):
            return
        moved = not geometry.all_covered and geometry.largest_difference(state.displacement, self._followed) > face.near
        if is_current and not moved:
            return
        slip = face.jump(state.displacement)[:, 1:]
        farthest = float(np.linalg.norm(slip - slip_then, axis=1).max())
        self._room = face.limit - farthest
        slid = farthest > face.limit
        if slid or moved:
            stored = self._energy_of_springs(state)
            self._remember(state, state.displacement, slip)
            self._stretch(state)
            state.add_energy(self._fault.name, "pairing_update_loss", stored - self._energy_of_springs(state))

    def _energy_of_springs(self, state: State) -> float:
        """Return the energy of compliant contact at the time of the velocity, points of this rank [J]."""
        if not any(self._fault.contact.stiffness()):
            return 0.0
        half = 0.5 * state.lag
        added = half * self.face.rate(state.velocity)
        return sum(self._fault.elastic_energy(state.faults[self._fault.name], added, half, state.fault_time))

    def _stretch(self, state: State) -> None:
        """Give springs the elastic jump between the new partners, at the time of the tractions."""
        if not any(self._fault.contact.stiffness()):
            return
        fault, fields, time = self._fault, state.faults[self._fault.name], state.fault_time
        jump = self.face.jump(state.displacement) - state.lag * self.face.rate(state.velocity)
        trial = closed_and_stuck(fault, jump, fault.components(fields, "slip"), Clock.of_step(state.lag), time)
        if self._cohesion is None:
            fields["normal_stress"][:] = np.maximum(trial.normal_stress, 0.0)
        else:
            stress, compliance = np.asarray(trial.normal_stress), np.asarray(trial.normal_compliance)
            cohesive = self._cohesion.strength_at(fields["damage"], fields["largest_opening"], compliance)
            fields["normal_stress"][:] = cohesive.normal_stress(stress)
            fields["opening"][:] = (fields["normal_stress"] - stress) * compliance
        for name, shear in zip(component_names("shear_traction", fault.tangents), trial.shear_traction, strict=True):
            fields[name][:] = shear

    def _recall(self, state: State) -> tuple[Floats, Floats]:
        """Restore the geometry of the last update, and return displacement and slip of that update."""
        field = FIELDS + self._fault.name
        if field not in state.fields:
            state.fields[field] = np.zeros_like(state.displacement)
        followed = state.fields[field]
        slip_then = self._fault.components(state.faults[self._fault.name], "slip_followed")
        if self._made is not state:
            self._follow(followed, slip_then)
            self._made, self._room = state, 0.0
        return followed, slip_then

    def _remember(self, state: State, displacement: Floats, slip: Floats) -> None:
        """Set the geometry from a displacement and the tangential jump there, and store both in the state."""
        followed, fields, dofs = state.fields[FIELDS + self._fault.name], state.faults[self._fault.name], self.face.dofs
        followed[dofs] = displacement[dofs]
        for name, along in zip(component_names("slip_followed", self._fault.tangents), slip.T, strict=True):
            fields[name][:] = along
        self._follow(followed, slip)
        self._made = state
        if self._cohesion is not None:  # a point that has lost its opposite surface has lost its cohesion, too
            fields["damage"][~self.face.covered] = 1.0
        if len(dofs):
            self._doubt(followed[dofs].reshape(-1, self.face.geometry.dim), state.fault_time)

    def _doubt(self, displacement: Floats, time: float) -> None:
        """Log surface strains or rotations that are too large for the theory of small strains, at each doubling."""
        plus, minus = self.face.geometry.plus, self.face.geometry.minus
        for side, moved in ((plus, displacement[: len(plus.nodes)]), (minus, displacement[len(plus.nodes) :])):
            if not len(side.nodes):  # rigid
                continue
            first, last = _lines(side)
            change = np.linalg.norm(moved[last] - moved[first], axis=1)
            change /= np.linalg.norm(side.points[last] - side.points[first], axis=1)
            worst = int(np.argmax(change))
            if change[worst] <= self._large:
                continue
            self._large = 2 * change[worst]
            LOG.warning(
                "faults.%s: the surface at (%s) m has strained or turned by %.2g at %.4g s: strains and "
                "rotations must stay below some per cent; reduce the loads, or make the bodies larger",
                self._fault.name, ", ".join(f"{x:.4g}" for x in side.points[first[worst]]), change[worst], time,
            )  # fmt: skip

    def _follow(self, displacement: Floats, slip: Floats, before: Floats | None = None) -> None:
        dofs, nodal = self.face.dofs, (-1, self.face.geometry.dim)
        begun = None if before is None else before[dofs].reshape(nodal)
        self._followed = displacement[dofs]
        try:
            self.face.geometry.follow(self._followed.reshape(nodal), slip, begun)
        except RuptfxError as error:
            raise RuptfxError(f"faults.{self._fault.name}: {error}") from None


def _lines(side: Surface) -> tuple[Integers, Integers]:
    """Return the nodes at both ends of the lines of nodes that cross the facets of a side."""
    facets = side.numbers.reshape(side.facets, *[side.order + 1] * (side.points.shape[1] - 1))
    ends = [
        np.concatenate([facets.take(at, axis=axis).ravel() for axis in range(1, facets.ndim)]) for at in (0, side.order)
    ]
    return ends[0], ends[1]


class StepFollower(Follower):
    """Updates the geometry of an interface in an implicit step, at whose end forces are in balance.

    A step is solved with the geometry of an estimate of its end, and again with that of its solution, until both
    agree (`change`). Slip continues from the beginning of the step.

    Parameters
    ----------
    fault : Fault
        Its interface slides.
    """

    def __init__(self, model: Discretisation, fault: Fault) -> None:
        super().__init__(fault)
        self.name, self._model = fault.name, model
        none, slip = np.zeros(0), np.zeros((0, fault.tangents))
        self._begun, self._slip_begun, self._pull_begun, self._stored_begun = none, slip, none, 0.0  # at the beginning
        self._estimate, self._taken, self._slip, self._pull = none, (none, slip), slip, none

    def begin(self, state: State) -> None:
        """Set the geometry at the beginning of a step."""
        self._recall(state)
        fields = state.faults[self.name]
        self._begun, self._slip_begun = state.displacement.copy(), self.face.jump(state.displacement)[:, 1:]
        self._pull_begun, self._stored_begun = self._pull_of(fields), self._energy(fields, state.time)

    def at(self, displacement: Floats) -> None:
        """Set the geometry at an estimate of the displacement at the end."""
        self._made, self._estimate = None, displacement.copy()
        self._follow(displacement, self._slip_begun, self._begun)

    def change(self, displacement: Floats, fields: FaultState, stiffness: Floats, largest: float) -> float:
        """Set the geometry at a solution for the previous geometry, and return the relative change.

        Parameters
        ----------
        displacement : ndarray, shape (nodes * components,)
            [m]
        fields : FaultState
            Fault fields of that solution.
        stiffness : ndarray, shape (n,)
            Stiffness of the bodies at every point [Pa/m].
        largest : float
            Largest normal stress of all points [Pa].

        Returns
        -------
        float
            Largest change of all points, as a part of the largest normal stress: of that which presses bodies together,
            and of its direction.
        """
        face, pressure = self.face, np.abs(fields["normal_stress"])
        before, normal = face.jump(displacement), face.frame[:, 0].copy()
        self._slip, self._pull = before[:, 1:], self._pull_of(fields)
        self._taken = self._estimate, face.jump(self._estimate)[:, 1:]
        self.at(displacement)
        if not len(face.plus):
            return 0.0
        gap = face.jump(displacement)[:, 0]
        closed = pressure > 0
        moved = np.where(closed, np.abs(gap - before[:, 0]), np.maximum(-gap, 0.0))
        moved = moved / (largest / stiffness + BARELY * face.geometry.plus.spacing)
        turned = np.linalg.norm(face.frame[:, 0] - normal, axis=1) * pressure / max(largest, 1e-300)
        return max(float(moved.max()), float(turned.max()))

    def slid(self) -> float:
        """Return the largest slip of the last solution of the step over its limit."""
        slip = np.linalg.norm(self._slip - self._slip_begun, axis=1)
        return float(np.max(slip / self.face.step_limit, initial=0.0))

    def commit(self, state: State, moved: Floats, dissipated: float) -> None:
        """Store the geometry of the solution, and count energy taken by the interface beyond friction and cohesion.

        Parameters
        ----------
        state : State
            State at the end of the step.
        moved : ndarray, shape (nodes * components,)
            Displacement added in the step [m].
        dissipated : float
            Energy taken by friction and cohesion at the points of this rank [J].
        """
        result = 0.5 * self._model.layout.owned_dot(self._pull_begun + self._pull, moved)
        self._remember(state, *self._taken)
        stored = self._energy(state.faults[self.name], state.time) - self._stored_begun
        state.add_energy(self.name, "impact_loss", result - dissipated - stored)

    def _pull_of(self, fields: FaultState) -> Floats:
        """Return J' W T [N]."""
        force = np.zeros(self._model.nodes * self._model.components)
        shear = self._fault.components(fields, "shear_traction")
        self.face.assemble(np.column_stack([-fields["normal_stress"], shear]), force)
        return force

    def _energy(self, fields: FaultState, time: float) -> float:
        """Return the elastic energy of the interface, points of this rank [J]."""
        return self._fault.elastic_energy(fields, np.zeros_like(self.face.geometry.offset), 0.0, time)[0]
