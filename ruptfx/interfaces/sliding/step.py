"""Explicit step of a sliding interface: the step of every point, in sweeps until the tractions converge.

Neighbouring points share nodes of the minus side, so that the traction of one changes the jump of the other. Trial,
projection and write-back are those of the step of a fault (`ruptfx.interfaces.faults.fault_step`), from jumps instead
of displacements, with the diagonal of J M^-1 J' as mobility. Compliant contact needs the jump of the displacement
only, and one such step. Rigid contact is solved in sweeps (`ContactMethod.sweeps_to`): all points at once, from the
velocities after the tractions of the last sweep, from the state at the beginning of the step. This is a Jacobi
iteration, the same for any partition; the first sweep begins with the tractions of the previous step. Blocks of points
that are so far open that they cannot close are skipped, which changes no bit. The code is C,
`step.c`; the tests have the same with arrays (`tests/helpers/reference_sliding.py`).
"""

from __future__ import annotations

import ctypes
import logging
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import Array
from ruptfx.interfaces.faults import cohesive_interface
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import FaultStep, point_columns
from ruptfx.interfaces.faults.held_points import beside_diagonal
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.point_code import LANES
from ruptfx.interfaces.faults.points import Clock
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.interfaces.sliding.surface import Floats, Integers
from ruptfx.platform.codegen.native import address

LOG = logging.getLogger("ruptfx.run")
SLACK = 1 + 1e-6  # factor of a bound, for rounding
RUN = 8  # nodes of the other side per block, as in jump.c
REPORTED = (1, 10, 100, 1000, 10_000)  # numbers of steps without convergence at which the log reports it


class _Sweeps(ctypes.Structure):
    """`struct sweeps` of step.c."""

    _fields_ = [
        ("most", ctypes.c_long), ("tolerance", ctypes.c_double), *(
            (name, ctypes.c_void_p) for name in (
                "push", "initial", "places", "begun", "frame", "offset", "load", "jump", "before", "traction", "rate",
            )
        ), ("parts", ctypes.c_long), *(
            (name, ctypes.c_void_p) for name in (
                "reach", "changed", "upto", "listed", "spread", "limit", "ever", "displaced",
            )
        ),
    ]  # fmt: skip


class _Points(FaultStep):
    """The points without their neighbours; rates and, in sweeps, tractions are inputs.

    Attributes
    ----------
    loss, fastest : float
        Energy lost in impacts [J] and the largest slip rate [m/s], in sweeps.
    """

    sources: ClassVar[tuple[str, ...]] = ("interfaces/sliding/jump.c", "interfaces/sliding/step.c")

    def __init__(self, fault: Fault, inverse_mass: Floats, clock: Clock, threshold: float, before: Floats) -> None:
        super().__init__(fault, inverse_mass, clock, threshold)
        self._inverse_mass, self._before = inverse_mass, address(before)
        self._result, self.loss, self.fastest = np.zeros(8), 0.0, 0.0

    def refresh(self) -> None:
        """Read weights and inverse masses again after changes in place."""
        for name, values in point_columns(self.fault, self._inverse_mass, self.clock).items():
            self._code.put(name, values)

    def put_shear(self, traction: Floats) -> None:
        """Set the initial shear traction of points without sweeps [Pa], shape (n, tangents)."""
        self._code.put("shear_traction_0", traction)

    def slide(
        self, face: SlidingInterface, sweeps: _Sweeps, state: FaultState, displacement: Floats, velocity: Floats,
        force: Floats, time: float,
    ) -> tuple[int, float]:  # fmt: skip
        """Advance the arrays in place; return the sweeps until convergence (0 without) and the dissipated energy [J].

        Raises
        ------
        ProjectionError
            A point without an admissible traction; `state` and `velocity` are then of no use.
        """
        items = (state, displacement, velocity, force)
        if not self._bound or any(a is not b for a, b in zip(self._bound, items, strict=True)):
            self._bind(*items)
        self._times[-2:] = self.fault.threshold_at(time, self._threshold), time
        _, times, _, _, displacements, velocities, forces, fixed, numbers, table, result = self._pointers
        value = self._library.slide(
            ctypes.byref(face.geometry.table), ctypes.byref(sweeps), times, numbers, fixed, table, displacements,
            self._before, velocities, forces, result,
        )  # fmt: skip
        if self._result[1] >= 0:
            self._code.fail(state, time, self._result)
        self.loss, self.fastest = float(self._result[6]), float(self._result[7])
        return value, float(self._result[0])


class SlidingStep:
    """Counterpart of `FaultStep` for sliding interfaces, with the same parameters, `work` and call.

    Parameters
    ----------
    before : (ndarray, ndarray of int)
        Velocities before the step, which the stepper keeps up to date [m/s], and the places there of the degrees of
        freedom of both surfaces.

    Attributes
    ----------
    unconverged : int
        Steps that ended without convergence after the largest number of sweeps.
    """

    def __init__(
        self, fault: Fault, inverse_mass: Floats, clock: Clock, threshold: float, before: tuple[Floats, Integers]
    ) -> None:
        face = fault.interface
        assert isinstance(face, SlidingInterface)
        self.fault, self.clock, self._face = fault, clock, face
        self.work, self.prescribed_work, self.unconverged = 0.0, 0.0, 0
        n, m, dim = len(face.plus), len(face.geometry.minus.nodes), face.geometry.dim
        self._inverse_mass = inverse_mass[face.dofs].reshape(-1, dim)
        self._mobility, self._area, self._revision = np.ones(dim * n), np.zeros(n), -1
        each = np.arange(n)
        points = Interface(
            face.points, face.position, face.number, each, each, np.tile(np.eye(dim), (n, 1, 1)), face.weight,
            face.owned, face.total, face.line, other_side="rigid",
        )  # fmt: skip
        # Nucleation is left out of the points and added here, to the tractions that they start from.
        bare = replace(fault, interface=points, nucleation=())
        self._points = _Points(bare, self._mobility, clock, threshold, before[0])
        # The initial stress of the bodies acts on the nodes where it acted at the start, wherever they slide.
        initial = np.zeros_like(inverse_mass)
        face.initial.assemble(np.column_stack([-fault.normal_stress_0, fault.shear_traction_0]), initial)
        self._filled = filled = -(-n // LANES) * LANES
        tolerance, sweeps = fault.contact.sweeps_to() or (0.0, 0)
        self._rigid = sweeps > 0
        self._frame, self._load = np.zeros((dim * dim + 1, filled)), np.zeros((dim - 1, filled))
        self._offset, self._before, self._rate, jump, traction = np.zeros((5, dim, filled))
        self._arrays = (
            self._nodal(clock.kick * inverse_mass[face.dofs]), self._nodal(initial[face.dofs]),
            np.ascontiguousarray(before[1][::dim], dtype=np.int64), np.zeros((dim, filled + m)), self._frame,
            self._offset, self._load, jump, self._before, traction, self._rate,
        )  # fmt: skip
        parts = -(-m // RUN)
        self._reach, changed = np.zeros((filled // LANES, 2), dtype=np.int64), np.zeros(parts, dtype=np.uint8)
        self._marks: list[NDArray[Any]] = [
            self._reach,
            changed,
            np.zeros(parts + 1, dtype=np.int64),
            np.zeros(0, dtype=np.int64),
            np.zeros(filled // LANES),
            np.zeros(filled // LANES),
            np.zeros(parts, dtype=np.uint8),
            np.zeros(0),
        ]
        self._sweeps = _Sweeps(
            sweeps, tolerance, *(array.ctypes.data for array in self._arrays), parts,
            *(array.ctypes.data for array in self._marks),
        )  # fmt: skip
        self._stress_before = np.zeros(n)
        self._opened = self._fractured = 0.0  # work of tension, and what cohesion took, in the last step [J]

    def _nodal(self, values: Floats) -> Floats:
        """Return values at all degrees of freedom of the two sides in the order of step.c."""
        n = len(self._face.plus)
        space = np.zeros(self._filled - n)
        components = values.reshape(-1, self._face.geometry.dim).T
        return np.stack([np.concatenate([each[:n], space, each[n:]]) for each in components])

    def opening_rate(self, state: FaultState, velocity: Floats, is_first: bool) -> None:
        """Return nothing: the step reads the previous velocities itself."""

    def impact_loss(self, state: FaultState, velocity: Floats, rate_old: Floats | None) -> float:
        """Return the work of the normal stress over a step that is not stored, points of this rank [J].

        For rigid contact it contains plastic impacts and the effect of frozen operators; for springs the error of steps
        in which a contact closes or opens.
        """
        if self._rigid:
            return self._points.loss - self._opened
        before, now = self._stress_before, state["normal_stress"]
        none: list[Array] = [0.0 * now]
        stored_before, stored = (self.fault.contact.stored(stress, none, 0.0, none) for stress in (before, now))
        work = -0.5 * (before + now) * self._before[0, : len(now)] * self.clock.since
        if not self.clock.since:  # initial overlap, as counted by the first half of a step
            work = 0.5 * (now - before) * self._face.rate(velocity)[:, 0] * self.clock.kick
        return self._sum(work - (stored - stored_before)) - self._opened

    def fractured(self, state: FaultState, velocity: Floats, rate_old: Floats | None) -> float:
        """Return the energy that cohesion dissipates in the step, points of this rank [J]."""
        return self._fractured

    def _split(self, old: FaultState, state: FaultState) -> float:
        """Split the work of the tractions of cohesive points: return the part in shear that cohesion takes [J].

        The work of tension is taken out of the impacts, `_opened` [J]; without what is stored cohesion takes it.
        """
        fault, n = self.fault, len(self._area)
        kept = self._sum(cohesive_interface.stored(state) - cohesive_interface.stored(old))
        if not self._rigid:
            losses = fault.cohesive_losses(old, state, self.clock.since)
            tension = self._sum(losses.tension)
            self._opened, self._fractured = tension + kept, self._sum(losses.shear) + tension
            return 0.0  # it is not in what the points have counted as friction
        assert fault.cohesion is not None
        opening, *slip = 0.5 * self.clock.kick * (self._before + self._rate)[:, :n]
        strength, traction = (
            fault.cohesion.remaining_cohesion(state["damage"]),
            fault.components(state, "shear_traction"),
        )
        size = np.linalg.norm(traction, axis=1)
        share = np.where(size > strength, strength / np.where(size > 0, size, 1.0), 1.0)
        shear = self._sum(share * np.sum(traction.T * slip, axis=0))
        self._opened = self._sum(np.maximum(-state["normal_stress"], 0.0) * opening)
        self._fractured = shear + self._opened - kept
        return shear

    def __call__(self, state: FaultState, displacement: Floats, velocity: Floats, force: Floats, time: float) -> float:
        """Advance `state`, `velocity` and `force` in place; return the energy dissipated on this rank [J].

        Raises
        ------
        ProjectionError
            A point without an admissible traction; `state` and `velocity` are then of no use.
        """
        face, fault = self._face, self.fault
        if not len(face.plus):
            return 0.0
        if self._revision != face.geometry.revision:
            self._refresh()
        n = len(face.plus)
        if fault.is_loaded:
            self._load[:, :n] = fault.load(time).T
        if not self._rigid:
            self._stress_before[:] = state["normal_stress"]
            if fault.is_loaded:
                self._points.put_shear(fault.driving_shear(time))
        cohesive = fault.cohesion is not None
        old = {name: values.copy() for name, values in state.items()} if cohesive else {}
        settled, dissipated = self._points.slide(face, self._sweeps, state, displacement, velocity, force, time)
        if self._rigid:
            if not settled:
                self._report(time)
            face.geometry.slides = SLACK * self.clock.dt * self._points.fastest
        if cohesive:
            dissipated -= self._split(old, state)
        if fault.is_loaded:
            self.work = self._taken(fault.load(time - self.clock.since), self._load[:, :n].T, state)
        return dissipated

    def _refresh(self) -> None:
        """Update the diagonal of J M^-1 J' after a change of the pairing.

        Where the mass couples both components of a point, the entry beside the diagonal is added: sweeps over all
        components at once then converge, also where both sides are held along one direction and the block is singular.
        On surfaces so many points share a node that sweeps with the diagonal may diverge, where the opposite side is
        the lighter one. The eigenvalues of J M^-1 J' are between the part of the own side and the sums of its rows, and
        the mean of both is the least mobility: sweeps then converge.
        """
        face, n = self._face, len(self._face.plus)
        own, other = self._inverse_mass[:n], self._inverse_mass[n:]
        coupling = face.geometry.coupling
        both = own + coupling.squared() @ other
        if face.geometry.dim == 3 and coupling.nodes:  # a rigid side has none
            sizes = replace(coupling, values=np.abs(coupling.values))
            across = sizes.transposed() @ face.weight
            row = sizes @ (across[:, None] * other)
            both = np.maximum(both, own + 0.5 * row / face.weight[:, None])
        mobility = np.einsum("ikc,ic->ik", face.frame**2, both)
        mobility += beside_diagonal(np.einsum("ikc,ic,ilc->ikl", face.frame, both, face.frame))
        # Points without a partner carry nothing, whatever their impedance.
        mobility[~face.covered] = np.where(own > 0, own, 1.0)[~face.covered]
        self._mobility[:] = mobility.ravel()
        acting = face.frame.reshape(n, -1) * face.covered[:, None]
        self._frame[:, :n] = np.column_stack([acting, face.weight]).T
        self._offset[:, :n] = face.geometry.offset.T
        self._points.refresh()
        self._area[:] = face.owned * face.weight
        # As many values as the velocities on the other side, whose number a pairing of lines changes.
        self._marks[7] = np.zeros(face.geometry.shape_across)
        self._sweeps.displaced = self._marks[7].ctypes.data
        self._find_reach()
        self._revision = face.geometry.revision

    def _find_reach(self) -> None:
        """Find the blocks of the other side that every block of points is paired with, of lines as a range."""
        coupling, n = self._face.geometry.coupling, len(self._face.plus)
        paired, spread = coupling.values != 0, np.zeros(self._filled)
        spread[:n] = np.abs(coupling.values).sum(axis=1)
        self._marks[4][:] = spread.reshape(-1, LANES).max(axis=1)
        if self._face.geometry.dim == 3:
            reached = np.zeros((self._filled // LANES, self._sweeps.parts), dtype=bool)
            reached[np.nonzero(paired)[0] // LANES, coupling.columns[paired] // RUN] = True
            begin = np.concatenate([[0], np.cumsum(np.count_nonzero(reached, axis=1))])
            self._marks[0], self._marks[3] = begin, np.ascontiguousarray(np.nonzero(reached)[1])
            self._sweeps.reach, self._sweeps.listed = self._marks[0].ctypes.data, self._marks[3].ctypes.data
            return
        none, columns = ~paired.any(axis=1), paired.shape[1]
        low, high = np.full(self._filled, coupling.nodes), np.zeros(self._filled, dtype=np.int64)
        low[:n] = np.where(none, coupling.nodes, coupling.first + np.argmax(paired, axis=1))
        high[:n] = np.where(none, 0, coupling.first + columns - np.argmax(paired[:, ::-1], axis=1))
        self._reach[:, 0] = low.reshape(-1, LANES).min(axis=1) // RUN
        self._reach[:, 1] = np.maximum(-(-high.reshape(-1, LANES).max(axis=1) // RUN), self._reach[:, 0])

    def _report(self, time: float) -> None:
        """Log some of the steps whose tractions have not converged."""
        self.unconverged += 1
        if self.unconverged in REPORTED:
            LOG.warning(
                "faults.%s: tractions did not converge within contact.sweeps = %d, step %d of that kind, at %.6g s; "
                "the run goes on with what they are, which a larger contact.tolerance allows", self.fault.name,
                self._sweeps.most, self.unconverged, time,
            )  # fmt: skip

    def _taken(self, traction_old: Floats, traction: Floats, state: FaultState) -> float:
        """Return the work of a shear traction over the step, points of this rank [J]."""
        if self._rigid:
            n = len(traction)
            before, rate, length = self._before[1:, :n].T, self._rate[1:, :n].T, self.clock.kick
        else:
            before = rate = self.fault.components(state, "mean_slip_rate")
            length = self.clock.since
        power = np.asarray(self.fault.contact.dissipated(traction_old, traction, before, rate))
        return self._sum(power.sum(axis=1)) * length

    def _sum(self, power: Floats) -> float:
        return float(self._area @ power)
