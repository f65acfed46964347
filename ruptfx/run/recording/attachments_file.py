"""Fields of attachments: `attachments.h5`, NetCDF4 with a group for every attachment."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ruptfx import Table
from ruptfx.interfaces.attachments import Attached, Attachment
from ruptfx.interfaces.mechanisms import Rows
from ruptfx.run.recording.growing_file import GrowingFile

BLOCK = 50  # records written at once


class AttachmentsFile(GrowingFile):
    """Histories of the recorded fields of every attachment against time and node; rank 0 only.

    Parameters
    ----------
    path : Path
        Records are added to what is there.
    attachments : sequence of (Attachment, Attached, Rows)
        With the coordinates of the nodes [m].
    attributes : dict
        Global attributes of the file.
    kept : int, optional
        Records of a file that is there already; later ones go.
    """

    def __init__(
        self, path: Path, attachments: Sequence[tuple[Attachment, Attached, Rows]], attributes: Table,
        kept: int | None = None,
    ) -> None:  # fmt: skip
        super().__init__(path)
        self._names = [attached.name for _, attached, _ in attachments]
        self._waiting: list[tuple[float, list[Rows]]] = []
        if self.resumed:
            for name in self._names if kept is not None else ():
                self._file[name].resize_dimension("time", kept)
            return
        self._file.attrs.update(attributes)
        for part, attached, positions in attachments:
            group = self._file.create_group(attached.name)
            group.dimensions = {"time": None, "node": attached.total}
            group.attrs["kind"] = part.kind()
            group.attrs["attachment"] = json.dumps(part.model_dump(mode="json"))
            columns: dict[str, tuple[tuple[str, ...], str, str]] = {"time": (("time",), "s", "time")}
            columns |= {axis: (("node",), "m", axis) for axis in positions}
            for field in attached.recorded_fields():
                for name in field.names(attached.model.components):
                    columns[name] = (("time", "node"), field.unit, field.long_name)
            for name, (dimensions, unit, text) in columns.items():
                variable = group.create_variable(name, dimensions, np.float64, fillvalue=np.nan)
                variable.attrs["units"], variable.attrs["long_name"] = unit, text
                if name in positions:
                    variable[:] = positions[name]
        self.flush()

    def append(self, now: float, rows: list[Rows]) -> None:
        """Add one record: the time [s], and the fields of every attachment."""
        self._waiting.append((now, rows))
        self.flush_if(len(self._waiting) >= BLOCK)

    def write(self) -> None:
        if not self._waiting:
            return
        for number, name in enumerate(self._names):
            group = self._file[name]
            begin = group.dimensions["time"].size
            group.resize_dimension("time", begin + len(self._waiting))
            group["time"][begin:] = [now for now, _ in self._waiting]
            for field in self._waiting[0][1][number]:
                group[field][begin:] = np.stack([rows[number][field] for _, rows in self._waiting])
        self._waiting = []
