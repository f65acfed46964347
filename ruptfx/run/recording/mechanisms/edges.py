"""Motion and force of the edges of bodies that break."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx.input.fields import extensive_unit
from ruptfx.interfaces.mechanisms.facets import Facets
from ruptfx.run.recording.edge_sums import REMARK, EdgeSums
from ruptfx.run.recording.mechanisms import Opening, Records
from ruptfx.run.recording.table_file import TableFile

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model

NAME = "edges.csv"


class EdgeRecords(Records):
    """`edges.csv`, at every record of the interfaces."""

    of = Facets

    def __init__(self, model: Model, mechanisms: Sequence[Facets]) -> None:
        super().__init__(model, mechanisms)
        self._sums = EdgeSums(model)
        self._table: TableFile | None = None

    def names(self) -> list[str]:
        return [NAME]

    def open(self, opening: Opening) -> None:
        remark = REMARK.format(extensive_unit("N", self.model.case.plane))
        self._table = TableFile(opening.out / NAME, self._sums.columns, remark, opening.kept("interface"))

    def read(self, state: State) -> tuple[float, list[float]]:
        return state.fault_time, self._sums.row(state)

    def append(self, time: float, data: list[float]) -> None:
        assert self._table is not None
        self._table.append(time, data)

    def reopen(self) -> list[Path]:
        assert self._table is not None
        return [self._table.path]

    def close(self) -> None:
        if self._table is not None:
            self._table.close()
