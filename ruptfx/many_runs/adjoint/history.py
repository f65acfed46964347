"""History of the interfaces in a segment of a run: the inputs of every step at every point, in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import component_names
from ruptfx.interfaces.mechanisms.faults import Faults
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault_step import FaultStep
    from ruptfx.many_runs.adjoint.point_map import PointMap

Floats = NDArray[np.float64]
LARGEST = 4e9
"""Largest memory of history and checkpoints of all ranks by default [bytes]."""


class RecordedStep:
    """Explicit step of a fault that first copies its inputs to a history, if that is recorded."""

    def __init__(self, step: FaultStep, history: History) -> None:
        self._step, self._history, self.fault = step, history, step.fault
        self.opening_rate, self.impact_loss, self.fractured = step.opening_rate, step.impact_loss, step.fractured

    @property
    def work(self) -> float:
        """Work of the nucleation in the last step, points of this rank [J]."""
        return self._step.work

    @property
    def prescribed_work(self) -> float:
        return self._step.prescribed_work

    def __call__(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> float:
        """Advance as the step does."""
        if self._history.recorded:
            self._history.read(state, displacement, velocity)
        return self._step(state, displacement, velocity, force, time)


class History:
    """Inputs of the steps of one fault in a segment of a run.

    Parameters
    ----------
    steps : int
        Of the longest segment.

    Attributes
    ----------
    rows : ndarray, shape (steps + 1, history, n)
        Inputs of every step, in the order of `PointMap.history`; the entry after the last step has the fields only.
    recorded : bool
        Whether steps copy their inputs.
    """

    def __init__(self, points: PointMap, steps: int) -> None:
        fault = points.fault
        self._face, self._next, self.recorded = fault.interface, 0, False
        t = fault.tangents
        self._names = [
            *component_names("slip", t), *component_names("mean_slip_rate", t), "normal_stress",
            *fault.friction.all_state_fields(),
        ]  # fmt: skip
        self.rows = np.empty((steps + 1, len(points.history), len(fault.interface.weight)))

    def begin(self) -> None:
        """Record from the next step on, as the first one of a segment."""
        self._next, self.recorded = 0, True

    def read(self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Copy jumps and fields at the start of the next step."""
        row, local = self.rows[self._next], self._face.frame.shape[1]
        row[:local], row[local : 2 * local] = self._face.jump(displacement).T, self._face.rate(velocity).T
        self._copy(state)
        self._next += 1

    def _copy(self, state: FaultState) -> None:
        row, local = self.rows[self._next], self._face.frame.shape[1]
        for place, name in enumerate(self._names, 2 * local):
            row[place] = state[name]

    def close(self, state: FaultState) -> None:
        """Copy the fields only, after the last step of a segment, and record no more."""
        self._copy(state)
        self.recorded = False


def bytes_of_step(mechanisms: Faults, points: list[PointMap]) -> float:
    """Return the memory of one step of all faults on all ranks [bytes]; collective."""
    size = sum(8.0 * len(each.history) * len(each.fault.interface.weight) for each in points)
    return float(parallel.total(mechanisms.model.comm, size))


def begin(mechanisms: Faults, points: list[PointMap], steps: int) -> list[History]:
    """Return empty histories of all faults for segments of a number of steps; steps fill them."""
    histories = [History(each, steps) for each in points]
    for of_kick in mechanisms.steps:
        for number, history in enumerate(histories):
            of_kick[number] = cast("FaultStep", RecordedStep(cast("FaultStep", of_kick[number]), history))
    return histories
