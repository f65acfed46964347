"""NetCDF4 files that grow during a run and remain readable however it ends."""

from __future__ import annotations

import time
from pathlib import Path

import h5netcdf
import h5py

FLUSH_EVERY = 5.0  # seconds of wall-clock time that numbers may wait in memory


class GrowingFile:
    """Base of such files, which define with `write` how to append the numbers in memory; rank 0 only.

    Parameters
    ----------
    path : Path
        Path of the file; an existing file is continued.

    Attributes
    ----------
    path : Path
    resumed : bool
        Whether the file existed.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.resumed = path, path.exists()
        self._flushed = time.monotonic()
        self._open("a" if self.resumed else "w")

    def _open(self, mode: str) -> None:
        self._disk = h5py.File(self.path, mode)
        self._file = h5netcdf.File(self._disk, mode)

    def write(self) -> None:
        """Append the numbers in memory to the file."""
        raise NotImplementedError

    def flush(self) -> None:
        """Write the numbers in memory to the disk."""
        self.write()
        # h5netcdf's own flush does not reach the disk: a killed run would leave a file that cannot be opened.
        self._file.flush()
        self._disk.flush()
        self._flushed = time.monotonic()

    def flush_if(self, many: bool) -> None:
        """Flush if many numbers are in memory, or for a long time."""
        if many or time.monotonic() - self._flushed > FLUSH_EVERY:
            self.flush()

    def reopen(self) -> None:
        """Close and reopen the file: only a closed HDF5 file may be copied."""
        self.close()
        self._open("a")

    def close(self) -> None:
        """Write remaining numbers and close the file."""
        try:
            self.flush()
            self._file.close()
        finally:
            self._disk.close()
