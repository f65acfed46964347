"""NetCDF4 files that grow while a run goes on; whatever ends it, they can be opened."""

from __future__ import annotations

import time
from pathlib import Path

import h5netcdf
import h5py

FLUSH_EVERY = 5.0  # seconds of wall-clock time that numbers may wait in memory


class GrowingFile:
    """What such files share; a file says with `write` how it adds what waits. Rank 0 only.

    Parameters
    ----------
    path : Path
        What is there is added to.

    Attributes
    ----------
    path : Path
    resumed : bool
        Whether there was a file.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.resumed = path, path.exists()
        self._flushed = time.monotonic()
        self._open("a" if self.resumed else "w")

    def _open(self, mode: str) -> None:
        self._disk = h5py.File(self.path, mode)
        self._file = h5netcdf.File(self._disk, mode)

    def write(self) -> None:
        """Add what waits in memory to the file."""
        raise NotImplementedError

    def flush(self) -> None:
        """Write what waits in memory, to the disk."""
        self.write()
        # h5netcdf's own flush stops short of the disk: a killed run would leave a file that cannot be opened.
        self._file.flush()
        self._disk.flush()
        self._flushed = time.monotonic()

    def flush_if(self, many: bool) -> None:
        """The same when many numbers wait, or when they have waited for long."""
        if many or time.monotonic() - self._flushed > FLUSH_EVERY:
            self.flush()

    def settle(self) -> None:
        """Close and open again: only a closed HDF5 file may be copied."""
        self.close()
        self._open("a")

    def close(self) -> None:
        """Write the rest."""
        try:
            self.flush()
            self._file.close()
        finally:
            self._disk.close()
