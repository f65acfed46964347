"""A run whose steps are visited again, forward or backward, with the history that a memory admits.

The run keeps the history of its last segment, and checkpoints of its state; a sweep computes the other segments again
from them (`ruptfx.many_runs.adjoint.checkpoints`). Steps are bitwise reproducible from a copy of the state, so that
sweeps do not depend on the memory.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.state import State
from ruptfx.many_runs.adjoint import history
from ruptfx.many_runs.adjoint.checkpoints import Schedule, schedule, split
from ruptfx.many_runs.adjoint.history import History
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.faults import Faults
    from ruptfx.many_runs.adjoint.point_map import PointMap
    from ruptfx.run.model import Model
    from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Visit:
    """One step of a sweep.

    Attributes
    ----------
    step : int
    rows, after : list of ndarray, shape (history, n)
        Inputs of the step of every fault, and those of the next one, of which only the fields are valid.
    """

    step: int
    rows: list[Floats]
    after: list[Floats]


@dataclass(frozen=True)
class Moved:
    """One step of a sweep forward with the motion of the bodies.

    Attributes
    ----------
    visit : Visit
    displacement, velocity : ndarray, shape (nodes * components,)
        Before the step.
    state : State
        After it.
    """

    visit: Visit
    displacement: Floats
    velocity: Floats
    state: State


class Recomputation:
    """The steps of a run, and visits of them in either direction; all methods are collective.

    Parameters
    ----------
    mechanism : Faults
        Of the motion.
    points : list of PointMap
        Of every fault; without any nothing is recorded.
    most : float
        Largest memory of history and checkpoints on all ranks [bytes].

    Attributes
    ----------
    schedule : Schedule or None
        None where nothing is recorded.
    histories : list of History
    steps_made : int
        Steps of all runs so far.

    Raises
    ------
    RuptfxError
        On all ranks, if the memory does not suffice for the history of one step.
    """

    def __init__(
        self, motion: LeapfrogMotion, mechanism: Faults, points: list[PointMap], steps: int, most: float
    ) -> None:
        self._motion, self._model, self._steps = motion, cast("Model", motion.model), steps
        self.steps_made, self.schedule = 0, self._scheduled(mechanism, points, most)
        self.histories: list[History] = []
        if self.schedule is not None:
            self.histories = history.begin(mechanism, points, self.schedule.length)
        self._checkpoints: dict[int, State] = {}
        self._present = -1  # the segment whose history is in memory

    def _scheduled(self, mechanism: Faults, points: list[PointMap], most: float) -> Schedule | None:
        if not points:
            return None
        state = self._model.initial_state()
        state.force = np.zeros(0)
        size = float(parallel.total(self._model.comm, float(sum(each.nbytes for each in _arrays(vars(state))))))
        return schedule(self._steps, history.bytes_of_step(mechanism, points), size, most)

    @property
    def attributes(self) -> dict[str, float | str]:
        """Memory [bytes], checkpoints, steps forward so far over those of the run, and the schedule in words."""
        if self.schedule is None:
            return {}
        return {
            "memory": self.schedule.memory, "checkpoints": self.schedule.stored,
            "forward_runs": self.steps_made / self._steps, "history": self.schedule.text,
        }  # fmt: skip

    # -- runs ----------------------------------------------------------------------------------------------------

    def run(self, observe: Callable[[int, State], None]) -> None:
        """Make the run; store its first checkpoints and the history of its last segment.

        Parameters
        ----------
        observe : callable
            Called with the number of steps done and the state, also at the start.
        """
        state, plan = self._model.initial_state(), self.schedule
        self._checkpoints.clear()
        self._present = -1
        stored = self._first_checkpoints() if plan is not None else []
        last = plan.segments - 1 if plan is not None else -1
        observe(0, state)
        for step in range(self._steps):
            if plan is not None and step % plan.length == 0:
                segment = step // plan.length
                if segment in stored:
                    self._checkpoints[segment] = _copied(state)
                if segment == last:
                    self._begin(segment)
            self._step(state)
            observe(step + 1, state)
        if plan is not None:
            self._close(state)

    def _first_checkpoints(self) -> list[int]:
        """Return the segments before which the backward sweep finds its checkpoints."""
        assert self.schedule is not None
        first_checkpoints, first, free = [], 0, self.schedule.stored
        while free and self.schedule.segments - first > 1:
            first += split(self.schedule.segments - first, free + 1)
            first_checkpoints.append(first)
            free -= 1
        return first_checkpoints

    def _step(self, state: State) -> None:
        error, comm = None, self._model.comm
        try:
            self._motion.step(state)
        except Exception as caught:
            error = caught
        if comm.size > 1:
            parallel.raise_on_all(comm, error)
        elif error is not None:
            raise error
        self.steps_made += 1

    def _begin(self, segment: int) -> None:
        self._present = segment
        for each in self.histories:
            each.begin()

    def _close(self, state: State) -> None:
        for each, name in zip(self.histories, state.faults, strict=True):
            each.close(state.faults[name])

    # -- visits --------------------------------------------------------------------------------------------------

    def forward(self) -> Iterator[Visit]:
        """Yield all steps in their order."""
        assert self.schedule is not None
        if self.schedule.segments == 1:
            yield from self._visits(0)
            return
        state = self._model.initial_state()
        for segment in range(self.schedule.segments):
            self._record(segment, state)
            yield from self._visits(segment)

    def with_bodies(self) -> Iterator[Moved]:
        """Make the run again and yield its steps in their order, with the motion of the bodies.

        What is kept for other sweeps stays.
        """
        kept, present = [each.rows for each in self.histories], self._present
        for each in self.histories:
            each.rows = np.empty((2, *each.rows.shape[1:]))
        try:
            state = self._model.initial_state()
            for step in range(self._steps):
                before = state.displacement.copy(), state.velocity.copy()
                self._begin(present)
                self._step(state)
                self._close(state)
                rows, after = ([each.rows[which] for each in self.histories] for which in (0, 1))
                yield Moved(Visit(step, rows, after), *before, state)
        finally:
            for each, rows_kept in zip(self.histories, kept, strict=True):
                each.rows = rows_kept

    def backward(self) -> Iterator[Visit]:
        """Yield all steps in the opposite order."""
        assert self.schedule is not None
        for segment in self._backward(0, self.schedule.segments, self.schedule.stored):
            yield from reversed(self._visits(segment))

    def _backward(self, first: int, end: int, free: int) -> Iterator[int]:
        """Yield segments from the last one on, each with its history in memory; `free` more checkpoints may be stored.

        The state before the first one is a checkpoint, or the start of the run.
        """
        if free == 0 or end - first == 1:
            for segment in reversed(range(first, end)):
                if segment != self._present:
                    self._record(segment, self._advanced(first, segment))
                yield segment
            return
        middle = first + split(end - first, free + 1)
        if middle not in self._checkpoints:
            self._checkpoints[middle] = _copied(self._advanced(first, middle))
        yield from self._backward(middle, end, free - 1)
        del self._checkpoints[middle]
        yield from self._backward(first, middle, free)

    def _advanced(self, first: int, end: int) -> State:
        """Return the state before a segment, from that before an earlier one."""
        assert self.schedule is not None
        state = self._model.initial_state()  # and no force is left of other steps
        if first:
            force = state.force
            state = _copied(self._checkpoints[first])
            state.force = force
        for _ in range(self.schedule.start(first), self.schedule.start(end)):
            self._step(state)
        return state

    def _record(self, segment: int, state: State) -> None:
        """Make the steps of a segment and keep their history."""
        assert self.schedule is not None
        self._begin(segment)
        for _ in range(self.schedule.start(segment), self.schedule.start(segment + 1)):
            self._step(state)
        self._close(state)

    def _visits(self, segment: int) -> list[Visit]:
        assert self.schedule is not None
        first = self.schedule.start(segment)
        return [
            Visit(
                step, [each.rows[step - first] for each in self.histories],
                [each.rows[step + 1 - first] for each in self.histories],
            )
            for step in range(first, self.schedule.start(segment + 1))
        ]  # fmt: skip


def _copied(state: State) -> State:
    """Return a copy of a state between steps, without the force."""
    force, state.force = state.force, np.zeros(0)
    try:
        return copy.deepcopy(state)
    finally:
        state.force = force


def _arrays(value: object) -> Iterator[np.ndarray]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from _arrays(each)
