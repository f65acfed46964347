"""Rows of all ranks in one order that no partition changes, of which every rank holds a slab: nothing is gathered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Numbers = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class _Exchange:
    """Rows on their way to other ranks, and back; made by all ranks together.

    Parameters
    ----------
    comm : MPI communicator
    target : ndarray of int, shape (rows,)
        The rank each local row goes to.
    """

    def __init__(self, comm: Comm, target: Indices) -> None:
        self._comm, self._order = comm, np.argsort(target, kind="stable")
        self._sent = np.bincount(target, minlength=comm.size)
        self._received = np.array(comm.alltoall(self._sent.tolist()), dtype=np.int64)

    def there(self, rows: Numbers) -> Numbers:
        """What all ranks have sent here, by rank; shape (received, columns) from (rows, columns)."""
        if self._comm.size == 1:
            return rows
        return self._move(rows[self._order], self._sent, self._received)

    def back(self, received: Numbers) -> Numbers:
        """The inverse."""
        if self._comm.size == 1:
            return received
        rows = np.empty((len(self._order), received.shape[1]))
        rows[self._order] = self._move(received, self._received, self._sent)
        return rows

    def _move(self, rows: Numbers, sent: Indices, received: Indices) -> Numbers:
        columns = rows.shape[1]
        arrived = np.empty((int(received.sum()), columns))
        leaving = np.ascontiguousarray(rows, dtype=np.float64)  # also of whole numbers: the others receive doubles
        self._comm.Alltoallv((leaving, (sent * columns).tolist()), (arrived, (received * columns).tolist()))
        return arrived


def bounds(total: int, ranks: int) -> Indices:
    """Places at which the slabs of some ranks begin, and the last ends; shape (ranks + 1,)."""
    return total * np.arange(ranks + 1) // ranks


class Slabs:
    """An order cut into one slab per rank; made by all ranks together.

    Parameters
    ----------
    comm : MPI communicator
    place : ndarray of int, shape (rows,)
        Place of every local row; the same place may be asked for by several ranks.
    total : int
        Number of places.

    Attributes
    ----------
    total : int
    here : slice
        Places of the slab of this rank.
    """

    def __init__(self, comm: Comm, place: Indices, total: int) -> None:
        cuts = bounds(total, comm.size)
        self.total, self.here = total, slice(int(cuts[comm.rank]), int(cuts[comm.rank + 1]))
        self._exchange = _Exchange(comm, np.searchsorted(cuts, place, side="right") - 1)
        arrived = self._exchange.there(place[:, None].astype(np.float64))
        self._place = arrived[:, 0].astype(np.int64) - self.here.start

    def collect(self, rows: Numbers) -> Numbers:
        """The slab of this rank, shape (places, columns), from rows of all, shape (rows, columns); collective."""
        slab = np.empty((self.here.stop - self.here.start, rows.shape[1]))
        slab[self._place] = self._exchange.there(rows)
        return slab

    def spread(self, slab: Numbers) -> Numbers:
        """The inverse of `collect`; collective."""
        return self._exchange.back(slab[self._place])
