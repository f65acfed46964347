"""Matrices of interfaces on disk, under a checksum of all that they depend on.

Every part of a matrix has a file of its own, so that a killed computation goes on where it ended.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

import numpy as np

from ruptfx import __version__
from ruptfx.platform import fem, parallel
from ruptfx.platform.codegen.native import cache_directory
from ruptfx.platform.run_files import replacing


def checksum_of(kind: str, arrays: Iterable[np.ndarray]) -> str:
    """Return the checksum of arrays, for matrices of one kind that this version of the code computes."""
    digest = hashlib.sha256(f"ruptfx {__version__}: {kind}".encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


class StoredParts:
    """Parts of a matrix, read from their files, or computed and written there.

    Parameters
    ----------
    checksum : str
        Of all that the parts depend on but their own names.
    comm : MPI communicator
        All ranks that have parts, the same ones or each its own.
    folder : Path, optional
        Default: that of the cache of compiled code.

    Attributes
    ----------
    folder : Path
    """

    def __init__(self, checksum: str, comm: fem.MPI.Comm, folder: Path | None = None) -> None:
        self._checksum, self._comm, self.folder = checksum, comm, folder or cache_directory() / "stiffness"
        self._is_read: dict[str, bool] = {}

    def part(
        self, name: str, shape: tuple[int, ...], compute: Callable[[], np.ndarray], comm: fem.MPI.Comm
    ) -> np.ndarray:  # fmt: skip
        """Return a part, the same on all ranks, from the file of rank 0 if it has one; collective.

        Parameters
        ----------
        name : str
            Distinguishes the parts of a checksum.
        shape : tuple of int
            Of the part; a file with another one is not used.
        compute : callable
            Returns the part; collective.
        comm : MPI communicator
            The ranks that share this part.
        """
        key = hashlib.sha256(f"{self._checksum} {name}".encode()).hexdigest()[:32]
        file = self.folder / f"{key}.npy"
        known = parallel.on_root(comm, lambda: _read(file, shape))
        self._is_read.setdefault(name, known is not None)
        if known is not None:
            return known
        array = compute()
        parallel.on_root(comm, lambda: _write(file, array))
        return array

    def counts(self) -> tuple[int, int]:
        """Return how many parts of all ranks were read when they were first needed, and how many computed; collective.

        A part that several ranks share counts once.
        """
        is_read: dict[str, bool] = {}
        for each in self._comm.allgather(self._is_read):
            is_read |= each
        read = sum(is_read.values())
        return read, len(is_read) - read

    def report(self, what: str) -> str:
        """Return a line for the log: how many parts of all ranks were read and how many computed; collective.

        Parameters
        ----------
        what : str
            Name of the parts.
        """
        read, computed = self.counts()
        if not computed:
            return f"{what}: all {read} read from {self.folder}, none computed"
        if not read:
            return f"{what}: all {computed} computed, and written to {self.folder}"
        return f"{what}: {read} read from {self.folder}, the other {computed} computed and written there"


def _read(file: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return the array of a file; None without one, or if it is damaged."""
    try:
        with file.open("rb") as stream:
            array, check = np.load(stream, allow_pickle=False), stream.read()
    except (OSError, ValueError, EOFError):
        return None
    return np.asarray(array) if array.shape == shape and check == _sum_of(array) else None


def _write(file: Path, array: np.ndarray) -> None:
    """Write an array and its checksum; on a full disk nothing, and the next run computes it again."""
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as part, part.open("wb") as stream:
            np.save(stream, array)
            stream.write(_sum_of(array))


def _sum_of(array: np.ndarray) -> bytes:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).digest()
