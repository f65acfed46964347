"""The explicit step of an interface that slides: the step of every point, repeated until neighbours agree.

Neighbouring points share the nodes they face, so that the traction of one changes the jump of the other. Trial,
projection and what is written back are those of the step of a fault (`ruptfx.fault_step`), from jumps instead of
displacements, with the diagonal of J M^-1 J' as mobility. Compliant contact needs the jump of the displacement alone,
and one such step. Rigid contact is solved in sweeps (`ContactMethod.sweeps_to`): all points at once, from the
velocities that the tractions of the last sweep leave, from the state at the beginning of the step. It is a Jacobi
iteration, the same for any partition; the first sweep begins with the tractions of the step before. All of it is C,
`step.c`; the tests have the same with arrays (`tests/reference_sliding.py`).
"""

from __future__ import annotations

import ctypes
import logging
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ruptfx.fault import Fault
from ruptfx.fault_step import FaultStep
from ruptfx.interface import Interface
from ruptfx.point_code import LANES
from ruptfx.points import Clock
from ruptfx.sliding.interface import SlidingInterface
from ruptfx.sliding.surface import Floats, Integers
from ruptfx.state import FaultState

LOG = logging.getLogger("ruptfx.run")
SLACK = 1 + 1e-6  # of a bound, for rounding
RUN = 8  # nodes of the other side that are looked at together, as in jump.c
REPORTED = (1, 10, 100, 1000, 10_000)  # numbers of steps that did not settle at which the log says so


class _Sweeps(ctypes.Structure):
    """`struct sweeps` of step.c."""

    _fields_ = [
        ("most", ctypes.c_long), ("tolerance", ctypes.c_double), *(
            (name, ctypes.c_void_p) for name in (
                "push", "initial", "begun", "pull", "frame", "jump", "load", "traction", "given", "rate",
            )
        ), ("parts", ctypes.c_long), ("reach", ctypes.c_void_p), ("stirred", ctypes.c_void_p),
    ]  # fmt: skip


class _Points(FaultStep):
    """The points by themselves, which are given jumps, stresses and rates."""

    sources: ClassVar[tuple[str, ...]] = ("sliding/jump.c", "sliding/step.c")

    def slide(
        self, face: SlidingInterface, sweeps: _Sweeps, state: FaultState, velocity: Floats, force: Floats, time: float
    ) -> tuple[int, float]:
        """Advance the arrays in place; sweeps until tractions settled (0 if they did not) and dissipated energy [J].

        Raises
        ------
        ProjectionError
            A point without an admissible traction; `state` and `velocity` are then of no use.
        """
        given = (state, velocity, velocity, force)  # no displacement: `sweeps` has its jump
        if not self._bound or any(a is not b for a, b in zip(self._bound, given, strict=True)):
            self._bind(*given)
        self._times[-1] = time
        _, times, *_, velocities, forces, fixed, numbers, table, result = self._pointers
        taken = self._library.slide(
            ctypes.byref(face.geometry.table), ctypes.byref(sweeps), times, numbers, fixed, table, velocities, forces,
            result,
        )  # fmt: skip
        if self._result[1] >= 0:
            self._code.fail(state, time, self._result)
        return taken, float(self._result[0])


class SlidingStep:
    """What `FaultStep` is for interfaces whose points are pairs of nodes: the same parameters, `work` and call.

    Parameters
    ----------
    before : (ndarray, ndarray of int)
        Velocities before the step, which the stepper keeps up to date [m/s], and the places there of the degrees of
        freedom of both surfaces.

    Attributes
    ----------
    unsettled : int
        Steps that ended with the last sweep that is allowed.
    """

    def __init__(
        self, fault: Fault, inverse_mass: Floats, clock: Clock, threshold: float, before: tuple[Floats, Integers]
    ) -> None:
        face = fault.interface
        assert isinstance(face, SlidingInterface)
        self.fault, self.clock, self._face, self._before = fault, clock, face, before
        self.work, self.unsettled = 0.0, 0
        n, m = len(face.plus), len(face.geometry.minus.nodes)
        self._inverse_mass = inverse_mass[face.dofs].reshape(-1, 2)
        self._mobility, self._area, self._revision = np.ones(2 * n), np.zeros(n), -1
        each = np.arange(n)
        points = Interface(
            face.points, face.position, face.number, each, each, np.tile(np.eye(2), (n, 1, 1)), face.weight, face.owned,
            face.total, face.line, other_side="rigid",
        )  # fmt: skip
        # Nucleation is left out of the points and added here, to the tractions that they start from.
        self._points = _Points(replace(fault, interface=points, nucleation=()), self._mobility, clock, threshold)
        # The initial stress of the bodies acts on the nodes where it acted at the start, wherever they slide.
        initial = np.zeros_like(inverse_mass)
        face.initial.assemble(np.column_stack([-fault.normal_stress_0, fault.shear_traction_0]), initial)
        self._filled = filled = -(-n // LANES) * LANES
        tolerance, most = fault.contact.sweeps_to() or (0.0, 0)
        self._rigid = most > 0
        self._frame = np.zeros((5, filled))
        self._jump, self._load, self._given = np.zeros((2, filled)), np.zeros(filled), np.zeros((2, filled))
        rate = np.zeros((2, filled))
        self._rate = rate[:, :n]
        arrays = (
            self._nodal(clock.kick * inverse_mass[face.dofs]), self._nodal(initial[face.dofs]),
            np.zeros((2, filled + m)), np.zeros((2, filled + m)), self._frame, self._jump, self._load,
            np.zeros((2, filled)), self._given, rate,
        )  # fmt: skip
        parts = -(-m // RUN)
        self._reach, stirred = np.zeros((filled // LANES, 2), dtype=np.int64), np.zeros((2, parts), dtype=np.uint8)
        self._arrays = (*arrays, stirred)
        self._sweeps = _Sweeps(
            most, tolerance, *(array.ctypes.data for array in arrays), parts, self._reach.ctypes.data,
            stirred.ctypes.data,
        )  # fmt: skip
        self._rate_before, self._stress_before = np.zeros((n, 2)), np.zeros(n)

    def _nodal(self, values: Floats) -> Floats:
        """Values at all degrees of freedom of the two sides as step.c wants them."""
        n = len(self._face.plus)
        x, y = values.reshape(-1, 2).T
        space = np.zeros(self._filled - n)
        return np.stack([np.concatenate([each[:n], space, each[n:]]) for each in (x, y)])

    def opening_rate(self, state: FaultState, velocity: Floats) -> None:
        """Nothing: the step looks at the velocities before it by itself."""

    def impact_loss(self, state: FaultState, velocity: Floats, rate_old: Floats | None) -> float:
        """Work of the normal stress over a step that is not stored, points of this rank [J].

        Of rigid contact it is that of plastic impacts, and what follows from frozen operators; of springs what a step
        makes of a contact that closes or opens within it.
        """
        if not self._rigid:
            before, now = self._stress_before, state["normal_stress"]
            none = [0.0 * now]
            held, holds = (self.fault.contact.stored(stress, none, 0.0, none) for stress in (before, now))
            work = -0.5 * (before + now) * self._rate_before[:, 0] * self.clock.since
            if not self.clock.since:  # of what overlaps at the start, as the first half of a step counts it
                work = 0.5 * (now - before) * self._face.rate(velocity)[:, 0] * self.clock.kick
            return self._sum(work - (holds - held))
        power = self.fault.contact.lost_in_impact(state["normal_stress"], self._rate_before[:, 0], self._rate[0])
        return self._sum(power) * self.clock.kick

    def __call__(self, state: FaultState, displacement: Floats, velocity: Floats, force: Floats, time: float) -> float:
        """Advance `state`, `velocity` and `force` in place; returns the energy dissipated on this rank [J].

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
        self._jump[:, :n] = face.jump(displacement).T
        if fault.is_loaded:
            self._load[:n] = fault.load(time)
        if not self._rigid:
            self._stress_before[:] = state["normal_stress"]
            self._given[0, :n], self._given[1, :n] = fault.normal_stress_0, fault.driving_shear(time)[:, 0]
        velocities, places = self._before
        self._rate_before = face.geometry.rate_at_nodes(velocities[places])
        settled, dissipated = self._points.slide(face, self._sweeps, state, velocity, force, time)
        if self._rigid:
            if not settled:
                self._report(time)
            dissipated = self._taken(state["shear_traction"], state["shear_traction"], state)
            face.geometry.slides = SLACK * self.clock.dt * float(np.abs(self._rate[1]).max())
        if fault.is_loaded:
            self.work = self._taken(fault.load(time - self.clock.since), self._load[:n], state)
        return dissipated

    def _refresh(self) -> None:
        """Take over who faces whom now: the diagonal of J M^-1 J'."""
        face, n = self._face, len(self._face.plus)
        own, other = self._inverse_mass[:n], self._inverse_mass[n:]
        mobility = np.einsum("ikc,ic->ik", face.frame**2, own + face.geometry.coupling.squared() @ other)
        # What faces nothing carries nothing, whatever its impedance.
        mobility[~face.covered] = np.where(own > 0, own, 1.0)[~face.covered]
        self._mobility[:] = mobility.ravel()
        acting = face.frame.reshape(n, 4) * face.covered[:, None]
        self._frame[:, :n] = np.column_stack([acting, face.weight]).T
        self._points.refresh()
        self._area[:] = face.owned * face.weight
        self._find_reach()
        self._revision = face.geometry.revision

    def _find_reach(self) -> None:
        """From the first to before the last part of the other side that blocks of points face."""
        coupling, n = self._face.geometry.coupling, len(self._face.plus)
        faced = coupling.values != 0
        none, columns = ~faced.any(axis=1), faced.shape[1]
        low, high = np.full(self._filled, coupling.nodes), np.zeros(self._filled, dtype=np.int64)
        low[:n] = np.where(none, coupling.nodes, coupling.first + np.argmax(faced, axis=1))
        high[:n] = np.where(none, 0, coupling.first + columns - np.argmax(faced[:, ::-1], axis=1))
        self._reach[:, 0] = low.reshape(-1, LANES).min(axis=1) // RUN
        self._reach[:, 1] = np.maximum(-(-high.reshape(-1, LANES).max(axis=1) // RUN), self._reach[:, 0])

    def _report(self, time: float) -> None:
        """A step whose tractions have not settled, now and then."""
        self.unsettled += 1
        if self.unsettled in REPORTED:
            LOG.warning(
                "faults.%s: tractions did not settle within contact.sweeps = %d, step %d of that kind, at %.6g s; the "
                "run goes on with what they are, which a larger contact.tolerance allows", self.fault.name,
                self._sweeps.most, self.unsettled, time,
            )  # fmt: skip

    def _taken(self, traction_old: Floats, traction: Floats, state: FaultState) -> float:
        """Work of a shear traction over the step, points of this rank [J].

        In sweeps on the jump of the velocities, so that the budget closes however well they have settled.
        """
        if self._rigid:
            before, rate, length = self._rate_before[:, 1], self._rate[1], self.clock.kick
        else:
            before = rate = state["mean_slip_rate"]
            length = self.clock.since
        return self._sum(self.fault.contact.dissipated(traction_old, traction, before, rate)) * length

    def _sum(self, power: Floats) -> float:
        return float(self._area @ power)
