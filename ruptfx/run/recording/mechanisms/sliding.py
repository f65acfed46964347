"""Forces between sliding bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx.interfaces.mechanisms.sliding import SlidingFaults
from ruptfx.run.recording import forces
from ruptfx.run.recording.mechanisms import Opening, Records
from ruptfx.run.recording.mechanisms.faults import file_name
from ruptfx.run.recording.table_file import TableFile

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model
    from ruptfx.run.recording.checkpoint import Keeper


class ForceRecords(Records):
    """`forces.csv`, or `forces_NAME.csv`: at every record of the interfaces, or means over an interval of their own."""

    of = SlidingFaults
    figures = {"contact": 1, "forces": 3, "surfaces": 5}

    def __init__(self, model: Model, mechanisms: Sequence[SlidingFaults]) -> None:
        super().__init__(model, mechanisms)
        (mechanism,) = mechanisms
        self._faults, self._threshold = mechanism.faults, model.case.output.rupture_threshold
        self._tables: dict[str, TableFile] = {}
        self._means: forces.ForceMeans | None = None
        if model.case.output.forces_interval is not None:
            self.schedule = "forces"
            self._means = forces.ForceMeans(model.comm, self._faults, self._threshold)

    def names(self) -> list[str]:
        return [file_name(self.model, fault, "forces", "csv") for fault in self._faults]

    def keepers(self) -> Mapping[str, Keeper]:
        return {} if self._means is None else {"means": self._means}

    def open(self, opening: Opening) -> None:
        remark = forces.remark(self._means is not None, self.model.case.plane)
        kept = opening.kept(self.schedule)
        for fault, name in zip(self._faults, self.names(), strict=True):
            self._tables[fault.name] = TableFile(opening.out / name, forces.columns(fault.tangents), remark, kept)

    def observe(self, state: State) -> None:
        if self._means is not None:
            self._means.observe(state)

    def read(self, state: State) -> tuple[float, dict[str, list[float]]]:
        if self._means is not None:
            return self._means.take()
        rows = {f.name: forces.row(self.model.comm, f, state, self._threshold) for f in self._faults}
        return state.fault_time, rows

    def append(self, time: float, data: dict[str, list[float]]) -> None:
        for name, values in data.items():
            self._tables[name].append(time, values)

    def reopen(self) -> list[Path]:
        return [table.path for table in self._tables.values()]

    def close(self) -> None:
        for table in self._tables.values():
            table.close()
