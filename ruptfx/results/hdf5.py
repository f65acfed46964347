"""HDF5 and NetCDF files that may hit a full disk.

The HDF5 library ends the process with a segmentation fault when it cannot write what it holds at the end of a file. It
therefore writes through a Python file that keeps what the disk does not take in memory: the library never sees the
error, which is raised when its file is closed.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py
    import xarray


class _File(io.RawIOBase):
    """A new file for the HDF5 library; `error` is the first one of a write."""

    def __init__(self, path: Path) -> None:
        self._number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._position = self._size = 0
        self._late: list[tuple[int, bytes]] = []
        self.error: OSError | None = None

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._position

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._position = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        return self._position

    def truncate(self, size: int | None = None) -> int:
        self._size = self._position if size is None else size
        self._attempt(lambda: os.truncate(self._number, self._size))
        return self._size

    def write(self, data: Any) -> int:
        content, offset = bytes(data), self._position
        self._position += len(content)
        self._size = max(self._size, self._position)
        self._attempt(lambda: self._write_all(offset, content))
        if self.error is not None:
            self._late.append((offset, content))
        return len(content)

    def _write_all(self, offset: int, content: bytes) -> None:
        written = 0
        while written < len(content):  # a write may end early at a limit of the size
            written += os.pwrite(self._number, content[written:], offset + written)

    def _attempt(self, action: Callable[[], None]) -> None:
        """Keep the first error instead of raising it; nothing is written after it."""
        if self.error is None:
            try:
                action()
            except OSError as error:
                self.error = error

    def check(self) -> None:
        """Raise the first error, while the library is not writing.

        Raises
        ------
        OSError
        """
        if self.error is not None:
            raise self.error

    def readinto(self, buffer: Any) -> int:
        count, first = len(buffer), self._position
        content = bytearray(os.pread(self._number, count, first).ljust(count, b"\0"))
        for offset, part in self._late:
            low, high = max(offset, first), min(offset + len(part), first + count)
            if low < high:
                content[low - first : high - first] = part[low - offset : high - offset]
        buffer[:] = content
        self._position += count
        return count

    def close(self) -> None:
        if not self.closed:
            os.close(self._number)
        super().close()


@contextmanager
def new_hdf5(path: Path) -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """Create an HDF5 file, and a function that raises the error of the disk early, before much is kept in memory.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    import h5py

    with _File(path) as file:
        with h5py.File(file, "w") as content:
            yield content, file.check
        file.check()


def write_netcdf(data: xarray.Dataset, path: Path, encoding: Mapping[Any, Any] | None = None) -> None:
    """Write a data set as NetCDF.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    with _File(path) as file:
        with h5netcdf.File(file, "w") as content:
            data.dump_to_store(H5NetCDFStore(content), encoding=encoding)
        file.check()
