"""Moment rate of surfaces at every step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.interfaces.mechanisms.faults import Faults
from ruptfx.platform import parallel
from ruptfx.run.recording.mechanisms import Opening, Records
from ruptfx.run.recording.table_file import TableFile

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model
    from ruptfx.run.recording.checkpoint import Keeper

NAME = "moment_rate.csv"
REMARK = (
    "time in s, of every step; of every surface its shear modulus times slip rate, integrated over its area, in N m/s"
)
Rows = list[list[float]]


class MomentRecords(Records):
    """`moment_rate.csv`, a row for every step, written at the records of the interfaces; only of surfaces.

    Every rank keeps the sums over its points between two records, where they are summed over the ranks.
    """

    of = Faults

    def __init__(self, model: Model, mechanisms: Sequence[Faults]) -> None:
        super().__init__(model, mechanisms)
        faults = [fault for each in mechanisms for fault in each.faults]
        self._faults = [fault for fault in faults if fault.interface.across is not None and not fault.slides]
        self._weights: list[np.ndarray] = []  # area times modulus, shape (tangents, tangents, n) [N]
        self._waiting: Rows = []  # time and moment rates of the points of this rank
        self._count = self._kept = 0  # rows in the file, and those of them that a checkpoint has
        self._time = -1.0  # of the last row [s]
        self._path = Path(NAME)
        self._file: TableFile | None = None

    def names(self) -> list[str]:
        return [NAME] if self._faults else []

    def keepers(self) -> Mapping[str, Keeper]:
        return {"moments": self} if self._faults else {}

    def gather(self) -> None:
        for fault in self._faults:
            face = fault.interface
            modulus = np.moveaxis(sides_of(self.model, face).modulus, 0, -1)
            self._weights.append(np.ascontiguousarray(face.owned * face.area * modulus))

    def open(self, opening: Opening) -> None:
        self._path = opening.out / NAME

    def observe(self, state: State) -> None:
        if not self._faults:
            return
        if state.fault_time > self._time:  # the first explicit step only completes the state at the start
            self._waiting.append([state.fault_time, *self._rates(state)])
            self._time = state.fault_time

    def _rates(self, state: State) -> list[float]:
        """Return the moment rate of every surface, points of this rank [N m/s]."""
        rates = []
        for fault, weight in zip(self._faults, self._weights, strict=True):
            rate = np.ascontiguousarray(fault.components(state.faults[fault.name], "slip_rate").T)
            # In every step of a surface: products of whole rows take a third of the time of one with three indices.
            product = sum(weight[i, j] * rate[i] * rate[j] for i, j in np.ndindex(weight.shape[:2]))
            speed = np.sqrt(sum(each * each for each in rate))
            rates.append(float(np.sum(product / np.where(speed > 0, speed, 1.0))))
        return rates

    def _sum(self) -> None:
        """Move the rows that wait to rank 0, summed over the ranks; collective."""
        rows = np.array(self._waiting).reshape(-1, 1 + len(self._faults))
        totals = parallel.total(self.model.comm, rows[:, 1:])
        keep = self.model.comm.rank == 0
        self._waiting = np.column_stack([rows[:, 0], totals if keep else 0.0 * totals]).tolist()

    def read(self, state: State) -> tuple[float, Rows]:
        if not self._faults:
            return state.fault_time, []
        self._sum()
        rows, self._waiting = self._waiting, []
        self._count += len(rows)
        return state.fault_time, rows

    def append(self, time: float, data: Rows) -> None:
        if self._file is None and data:  # after `restore`
            columns = [fault.name for fault in self._faults]
            self._file = TableFile(self._path, columns, REMARK, self._kept)
        for row in data:
            assert self._file is not None
            self._file.append(row[0], row[1:])

    def complete(self) -> None:
        self.append(0.0, self._waiting)

    def table(self) -> Table:
        """Return the rows that wait and the number of those in the file, on rank 0; collective."""
        self._sum()
        return {"waiting": self._waiting, "count": self._count, "time": self._time}

    def restore(self, table: Table) -> None:
        """Continue from a checkpoint."""
        keep = self.model.comm.rank == 0
        self._waiting = [[row[0], *(value * keep for value in row[1:])] for row in table["waiting"]]
        self._count, self._time = table["count"], table["time"]
        self._kept = self._count

    def reopen(self) -> list[Path]:
        return [self._path] if self._path.exists() and self._faults else []

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
