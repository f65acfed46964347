"""An HDF5 file with all rows, of which every rank writes its block to a part of its own."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import h5py
import numpy as np
import numpy.typing as npt

from ruptfx.platform import distributed_rows

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Rows = npt.NDArray[np.float64] | npt.NDArray[np.int32] | npt.NDArray[np.int64]


class SharedFile:
    """`name.h5`, with the parts `name.0.h5`, `name.1.h5` ... of its virtual data sets for several ranks.

    Ranks write independently; rows that a part does not have yet are missing (NaN) in the whole.

    Parameters
    ----------
    comm : MPI communicator
    path : Path
        The file; it and its parts are created again.
    compression : int
        Level of gzip for appended data, 0 for none.

    Attributes
    ----------
    whole : h5py.File or None
        The file, on rank 0 only.
    paths : list of Path
        Files that this rank writes.
    """

    def __init__(self, comm: Comm, path: Path, compression: int = 0) -> None:
        self._filters = {"compression": compression, "shuffle": True} if compression else {}
        self._alone, self._size = comm.size == 1, comm.size
        self._names = [f"{path.stem}.{rank}{path.suffix}" for rank in range(comm.size)]
        part = path if self._alone else path.with_name(self._names[comm.rank])
        self.paths = [part] if self._alone or comm.rank else [path, part]
        self._open("w")

    def _open(self, mode: str) -> None:
        files = [h5py.File(path, mode) for path in self.paths]
        self._part = files[-1]
        self.whole = files[0] if self._alone or len(files) == 2 else None

    def write(self, name: str, block: Rows, total: int, **attributes: str) -> None:
        """Write a data set of `total` rows, of which this rank has a block."""
        self._part.create_dataset(name, data=block)
        self._show(name, block, total, False, attributes)

    def append(self, name: str, block: Rows, total: int, **attributes: str) -> None:
        """Append one time to such a data set."""
        if name not in self._part:
            shape = block.shape
            chunks = {"maxshape": (None, *shape), "chunks": (1, *shape)}
            self._part.create_dataset(name, (0, *shape), block.dtype, **chunks, **self._filters)
            self._show(name, block, total, True, attributes)
        data = self._part[name]
        data.resize(len(data) + 1, axis=0)
        data[-1] = block

    def _show(self, name: str, block: Rows, total: int, grows: bool, attributes: dict[str, str]) -> None:
        """Create the virtual data set of all parts."""
        if self.whole is None:
            return
        if not self._alone:
            first, most, every = ((1,), (None,), (slice(0, h5py.h5s.UNLIMITED),)) if grows else ((), (), ())
            columns, bounds = block.shape[1:], distributed_rows.bounds(total, self._size)
            layout = h5py.VirtualLayout((*first, total, *columns), block.dtype, (*most, total, *columns))
            for part, begin, end in zip(self._names, bounds[:-1], bounds[1:], strict=True):
                rows = (int(end - begin), *columns)
                source = h5py.VirtualSource(part, name, (*first, *rows), block.dtype, (*most, *rows))
                layout[(*every, slice(int(begin), int(end)))] = source[(*every, slice(None))]
            missing = np.nan if block.dtype.kind == "f" else None
            self.whole.create_virtual_dataset(name, layout, fillvalue=missing)
        self.whole[name].attrs.update(attributes)

    def flush(self) -> None:
        """Write the data in memory."""
        self._part.flush()
        if self.whole is not None:
            self.whole.flush()

    def reopen(self) -> None:
        """Close and reopen the files: only a closed HDF5 file may be copied."""
        self.close()
        self._open("a")

    def close(self) -> None:
        self._part.close()
        if self.whole is not None:
            self.whole.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
