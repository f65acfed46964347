"""Everything collective that is not the finite element stack's own: raise on all ranks, gather, reduce.

Also rounding that makes numbers the same on any number of ranks.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from ruptfx import RuptfxError

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Result = TypeVar("Result")


def raise_on_all(comm: Comm, error: Exception | None) -> None:
    """Every rank calls this; if any rank has an error, all raise the one of the lowest such rank.

    Parameters
    ----------
    comm : MPI communicator
    error : Exception or None
        What went wrong on this rank.

    Raises
    ------
    RuptfxError
        The first error's own type when it is one of ours, so that the caller can tell them apart.
    """
    found = comm.allgather(None if error is None else (type(error), str(error)))
    first = next((item for item in found if item is not None), None)
    if first is not None:
        kind, message = first
        raise (kind if issubclass(kind, RuptfxError) else RuptfxError)(message) from error


def rest(comm: Comm) -> None:
    """Wait for all ranks asleep: MPI itself would wait busily, and take the core from whoever works."""
    everyone = comm.Ibarrier()
    while not everyone.Test():
        time.sleep(0.01)


def on_root(comm: Comm, action: Callable[[], Result]) -> Result:
    """The result of `action` on rank 0, on every rank; an error there is raised everywhere."""
    result, error = None, None
    if comm.rank == 0:
        try:
            result = action()
        except Exception as caught:
            error = caught
    raise_on_all(comm, error)
    return comm.bcast(result, root=0)


def total(comm: Comm, values: npt.ArrayLike) -> np.ndarray:
    """Sum over ranks of an array or a number."""
    return np.asarray(comm.allreduce(np.asarray(values, dtype=float)))


def largest(comm: Comm, value: float) -> float:
    """Largest value of all ranks."""
    return max(comm.allgather(float(value)))


def anywhere(comm: Comm, flag: bool) -> bool:
    """Whether it holds on any rank."""
    return any(comm.allgather(bool(flag)))


def gather_rows(comm: Comm, rows: np.ndarray) -> np.ndarray | None:
    """Rows of all ranks, one below the other, on rank 0; None elsewhere."""
    parts = comm.gather(np.ascontiguousarray(rows), root=0)
    return None if parts is None else np.concatenate(parts)


def share_rows(comm: Comm, rows: np.ndarray) -> np.ndarray:
    """Rows of all ranks, one below the other, on every rank."""
    return np.concatenate(comm.allgather(np.ascontiguousarray(rows)))


def places(comm: Comm, rows: np.ndarray) -> np.ndarray:
    """Where rows of this rank stand among those of all, sorted by their last column, then by the one before and so on.

    Each rank sorts about as many as it has, those between two rows that are taken as limits (sample sort): they never
    come together on one rank. Rows that are the same keep the order of the ranks.

    Returns
    -------
    ndarray of int, shape (rows,)
    """
    if comm.size == 1:
        alone = np.empty(len(rows), dtype=np.int64)
        alone[_sorted(rows)] = np.arange(len(rows))
        return alone
    samples = rows[np.lexsort(rows.T)][np.linspace(0, len(rows), comm.size, endpoint=False, dtype=int)[: len(rows)]]
    everything = share_rows(comm, samples)
    everything = everything[np.lexsort(everything.T)]
    limits = everything[np.linspace(0, len(everything), comm.size, endpoint=False, dtype=int)[1:]]
    # A row goes to the rank whose limits it is between; limits come before rows that are the same.
    mixed = np.lexsort(np.concatenate([limits, rows]).T)
    to = np.empty(len(rows), dtype=np.int64)
    to[mixed[mixed >= len(limits)] - len(limits)] = np.cumsum(mixed < len(limits))[mixed >= len(limits)]
    sent = [np.flatnonzero(to == rank) for rank in range(comm.size)]
    received = comm.alltoall([rows[which] for which in sent])
    order = np.lexsort(np.concatenate(received).T)
    place = np.empty(len(order), dtype=np.int64)
    place[order] = sum(comm.allgather(len(order))[: comm.rank]) + np.arange(len(order))
    back = comm.alltoall(np.split(place, np.cumsum([len(part) for part in received])[:-1]))
    result = np.empty(len(rows), dtype=np.int64)
    for which, found in zip(sent, back, strict=True):
        result[which] = found
    return result


def _sorted(rows: np.ndarray) -> np.ndarray:
    """Order of rows by their last column, then by the one before and so on; often the last is enough."""
    order = np.argsort(rows[:, -1], kind="stable")
    last = rows[order, -1]
    return np.lexsort(rows.T) if np.any(last[1:] == last[:-1]) else order


def three_digits(value: float) -> float:
    """Rounded down, so that a result does not depend on the last digits of an eigenvalue and hence on the ranks."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(np.floor(value / unit * (1 + 1e-9)) * unit)
