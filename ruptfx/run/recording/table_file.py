"""CSV tables that grow a row at a time during a run."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

HEADER = 2  # lines before the first row


class TableFile:
    """Table with one row for every record; rank 0 only.

    Parameters
    ----------
    path : Path
        Path of the table; an existing one is continued.
    columns : iterable of str
        Names of the columns after the time.
    remark : str
        Contents and units of the table: the first line of the file.
    kept : int, optional
        Number of rows to keep in an existing table; later ones are removed.
    """

    def __init__(self, path: Path, columns: Iterable[str], remark: str, kept: int | None = None) -> None:
        self.path = path
        begins = not path.exists()
        if not begins and kept is not None:
            lines = path.read_bytes().splitlines(keepends=True)
            path.write_bytes(b"".join(lines[: HEADER + kept]))
        self._file = path.open("a", newline="")
        self._table = csv.writer(self._file)
        if begins:
            self._file.write(f"# {remark}\n")
            self._table.writerow(["time", *columns])

    def append(self, time: float, row: Iterable[float]) -> None:
        """Append a row at a time [s]; it is on the disk when this returns."""
        self._table.writerow([repr(value) for value in (time, *row)])
        self._file.flush()

    def close(self) -> None:
        self._file.close()
