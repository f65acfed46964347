"""Redistribute rows into a partition-independent order, one contiguous block per rank, without gathering them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Numbers = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class _Exchange:
    """Exchange of rows with other ranks in both directions; created by all ranks together.

    Parameters
    ----------
    comm : MPI communicator
    target : ndarray of int, shape (rows,)
        Destination rank of each local row.
    """

    def __init__(self, comm: Comm, target: Indices) -> None:
        self._comm, self._order = comm, np.argsort(target, kind="stable")
        self._sent = np.bincount(target, minlength=comm.size)
        self._received = np.array(comm.alltoall(self._sent.tolist()), dtype=np.int64)

    def forward(self, rows: Numbers) -> Numbers:
        """Send rows to their targets; return those received, by rank, shape (received, columns)."""
        if self._comm.size == 1:
            return rows
        return self._move(rows[self._order], self._sent, self._received)

    def backward(self, received: Numbers) -> Numbers:
        """Send received rows back, the inverse of `forward`."""
        if self._comm.size == 1:
            return received
        rows = np.empty((len(self._order), received.shape[1]))
        rows[self._order] = self._move(received, self._received, self._sent)
        return rows

    def _move(self, rows: Numbers, sent: Indices, received: Indices) -> Numbers:
        columns = rows.shape[1]
        arrived = np.empty((int(received.sum()), columns))
        leaving = np.ascontiguousarray(rows, dtype=np.float64)  # also integers: other ranks receive doubles
        self._comm.Alltoallv((leaving, (sent * columns).tolist()), (arrived, (received * columns).tolist()))
        return arrived


def bounds(total: int, ranks: int) -> Indices:
    """Return the first row of each block, and the end of the last; shape (ranks + 1,)."""
    return total * np.arange(ranks + 1) // ranks


class RowDistribution:
    """A global order cut into one block per rank; created by all ranks together.

    Parameters
    ----------
    comm : MPI communicator
    place : ndarray of int, shape (rows,)
        Global index of every local row; several ranks may have the same index.
    total : int
        Number of global rows.

    Attributes
    ----------
    total : int
    here : slice
        Global indices of the block of this rank.
    """

    def __init__(self, comm: Comm, place: Indices, total: int) -> None:
        cuts = bounds(total, comm.size)
        self.total, self.here = total, slice(int(cuts[comm.rank]), int(cuts[comm.rank + 1]))
        self._exchange = _Exchange(comm, np.searchsorted(cuts, place, side="right") - 1)
        arrived = self._exchange.forward(place[:, None].astype(np.float64))
        self._place = arrived[:, 0].astype(np.int64) - self.here.start

    def collect(self, rows: Numbers) -> Numbers:
        """Return the block of this rank, shape (places, columns), from local rows (rows, columns); collective."""
        block = np.empty((self.here.stop - self.here.start, rows.shape[1]))
        block[self._place] = self._exchange.forward(rows)
        return block

    def spread(self, block: Numbers) -> Numbers:
        """Return the local rows from the block, the inverse of `collect`; collective."""
        return self._exchange.backward(block[self._place])
