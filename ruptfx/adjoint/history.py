"""History of the interfaces of a run: the inputs of every step at every point, in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.fields import component_names
from ruptfx.mechanisms.faults import Faults
from ruptfx.platform import parallel
from ruptfx.state import FaultState, State

if TYPE_CHECKING:
    from ruptfx.adjoint.point_map import PointMap
    from ruptfx.faults.fault_step import FaultStep

Floats = NDArray[np.float64]
LARGEST = 4e9
"""Largest history of all ranks by default [bytes]."""


class RecordedStep:
    """Explicit step of a fault that first copies its inputs to a history.

    Parameters
    ----------
    step : FaultStep
    history : History
    """

    def __init__(self, step: FaultStep, history: History) -> None:
        self._step, self._history, self.fault = step, history, step.fault
        self.opening_rate, self.impact_loss, self.fractured = step.opening_rate, step.impact_loss, step.fractured

    @property
    def work(self) -> float:
        """Work of the nucleation in the last step, points of this rank [J]."""
        return self._step.work

    def __call__(
        self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, time: float
    ) -> float:
        """Advance as the step does."""
        self._history.read(state, displacement, velocity)
        return self._step(state, displacement, velocity, force, time)


class History:
    """Inputs of the steps of one fault.

    Parameters
    ----------
    points : PointMap
    steps : int

    Attributes
    ----------
    rows : ndarray, shape (steps + 1, history, n)
        Inputs of every step, in the order of `PointMap.history`; the last entry has the fields after the run.
    """

    def __init__(self, points: PointMap, steps: int) -> None:
        fault = points.fault
        self._face, self._next = fault.interface, 0
        t = fault.tangents
        self._names = [
            *component_names("slip", t), *component_names("mean_slip_rate", t), "normal_stress",
            *fault.friction.all_state_fields(),
        ]  # fmt: skip
        self.rows = np.empty((steps + 1, len(points.history), len(fault.interface.weight)))

    def begin(self) -> None:
        """Start again at the first step."""
        self._next = 0

    def read(self, state: FaultState, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Copy jumps and fields at the start of the next step."""
        row, local = self.rows[self._next], self._face.frame.shape[1]
        row[:local], row[local : 2 * local] = self._face.jump(displacement).T, self._face.rate(velocity).T
        self.close(state)

    def close(self, state: FaultState) -> None:
        """Copy the fields only, at the end of the run."""
        row, local = self.rows[self._next], self._face.frame.shape[1]
        for place, name in enumerate(self._names, 2 * local):
            row[place] = state[name]
        self._next += 1


def begin(mechanisms: Faults, points: list[PointMap], steps: int, most: float = LARGEST) -> list[History]:
    """Return empty histories of all faults, which their steps fill; collective.

    Raises
    ------
    RuptfxError
        On all ranks, if they are larger than `most` [bytes].
    """
    sizes = [8.0 * (steps + 1) * len(each.history) * len(each.fault.interface.weight) for each in points]
    size = float(parallel.total(mechanisms.model.comm, sum(sizes)))
    if size > most:
        raise RuptfxError(
            f"the history of the interfaces of {steps} steps needs {size / 1e9:.3g} GB of memory, and at most "
            f"{most / 1e9:.3g} GB are allowed; shorten duration, use larger elements, or allow more with --memory"
        )
    histories = [History(each, steps) for each in points]
    for of_kick in mechanisms.steps:
        for number, history in enumerate(histories):
            of_kick[number] = cast("FaultStep", RecordedStep(cast("FaultStep", of_kick[number]), history))
    return histories


def end(histories: list[History], state: State) -> None:
    """Copy the fields after the last step."""
    for history, name in zip(histories, state.faults, strict=True):
        history.close(state.faults[name])
