"""Fields of attachments: one file with a group for each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx.interfaces.attachments import Attached
from ruptfx.interfaces.mechanisms import Rows
from ruptfx.run.recording.attachments_file import AttachmentsFile
from ruptfx.run.recording.mechanisms import Opening, Records

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model

NAME = "attachments.h5"


class AttachmentRecords(Records):
    """`attachments.h5`, at every record of the interfaces."""

    of = Attached

    def __init__(self, model: Model, mechanisms: Sequence[Attached]) -> None:
        super().__init__(model, mechanisms)
        by_name = {each.name: each for each in mechanisms}
        self._attached = [by_name[part.name] for part in model.case.attachments]
        self._positions: list[Rows] = []
        self._file: AttachmentsFile | None = None

    def names(self) -> list[str]:
        return [NAME]

    def gather(self) -> None:
        self._positions = [each.positions() for each in self._attached]

    def open(self, opening: Opening) -> None:
        parts = list(zip(self.model.case.attachments, self._attached, self._positions, strict=True))
        about = {"record": "all fields of a record are those of its time", **opening.about}
        self._file = AttachmentsFile(opening.out / NAME, parts, about, opening.kept("interface"))

    def read(self, state: State) -> tuple[float, list[Rows]]:
        return state.fault_time, [each.record(state) for each in self._attached]

    def append(self, time: float, data: list[Rows]) -> None:
        assert self._file is not None
        self._file.append(time, data)

    def reopen(self) -> list[Path]:
        assert self._file is not None
        self._file.reopen()
        return [self._file.path]

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def numbers(self, records: int, snapshots: int) -> float:
        return float(records * sum(each.numbers_per_record() for each in self._attached))
