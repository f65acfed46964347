"""Collective operations besides those of the finite element stack: raise on all ranks, gather, reduce.

Also rounding of numbers for results that do not depend on the number of ranks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from ruptfx import RuptfxError

if TYPE_CHECKING:
    from mpi4py.MPI import Comm

Result = TypeVar("Result")


def raise_on_all(comm: Comm, error: Exception | None) -> None:
    """Raise the error of the lowest rank that has one on all ranks; collective.

    Parameters
    ----------
    comm : MPI communicator
    error : Exception or None
        Error of this rank.

    Raises
    ------
    RuptfxError
        Of the type of the first error if that is a RuptfxError, so that callers can distinguish errors.
    """
    result = comm.allgather(None if error is None else (type(error), str(error)))
    first = next((item for item in result if item is not None), None)
    if first is not None:
        kind, message = first
        raise (kind if issubclass(kind, RuptfxError) else RuptfxError)(message) from error


def rest(comm: Comm) -> None:
    """Wait for all ranks in sleep, as MPI barriers wait busily and occupy a core."""
    everyone = comm.Ibarrier()
    while not everyone.Test():
        time.sleep(0.01)


def on_root(comm: Comm, action: Callable[[], Result]) -> Result:
    """Run `action` on rank 0 and return its result on every rank; an error there is raised everywhere."""
    result, error = None, None
    if comm.rank == 0:
        try:
            result = action()
        except Exception as caught:
            error = caught
    raise_on_all(comm, error)
    return comm.bcast(result, root=0)


def agreed(comm: Comm, value: Result) -> Result:
    """Return the value of the first rank, as all compute the same up to rounding; collective."""
    return value if comm.size == 1 else comm.bcast(value, root=0)


def total(comm: Comm, values: npt.ArrayLike) -> np.ndarray:
    """Return the sum over ranks of an array or a number, of the same shape; collective."""
    return np.asarray(comm.allreduce(np.asarray(values, dtype=float)))


def largest(comm: Comm, value: float) -> float:
    """Return the largest value of all ranks."""
    return max(comm.allgather(float(value)))


def anywhere(comm: Comm, flag: bool) -> bool:
    """Return whether the flag is set on any rank."""
    return any(comm.allgather(bool(flag)))


def ranks_here(comm: Comm) -> int:
    """Return the number of ranks that share the memory of this machine; collective."""
    from mpi4py import MPI

    return int(comm.Split_type(MPI.COMM_TYPE_SHARED).size) if comm.size > 1 else 1


def gather_rows(comm: Comm, rows: np.ndarray) -> np.ndarray | None:
    """Return the rows of all ranks, shape (rows of all, ...), on rank 0, and None elsewhere; collective."""
    parts = comm.gather(np.ascontiguousarray(rows), root=0)
    return None if parts is None else np.concatenate(parts)


def gather_fields(
    comm: Comm, number: np.ndarray, owned: np.ndarray, fields: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return fields of points of all ranks by name on rank 0, in ascending order of their numbers; empty elsewhere.

    Parameters
    ----------
    number : ndarray of int, shape (n,)
        Of the points of this rank, the same on any partition.
    owned : ndarray of bool, shape (n,)
        Points that this rank contributes.
    fields : mapping of str to ndarray, shape (n,)
    """
    rows = np.stack([number.astype(float), *fields.values()], axis=1)[owned]
    gathered = gather_rows(comm, rows)
    if gathered is None:
        gathered = np.zeros((0, 1 + len(fields)))
    ordered = gathered[np.argsort(gathered[:, 0], kind="stable"), 1:]
    return dict(zip(fields, np.ascontiguousarray(ordered.T), strict=True))


def share_rows(comm: Comm, rows: np.ndarray) -> np.ndarray:
    """Return the rows of all ranks, one below the other, on every rank."""
    return np.concatenate(comm.allgather(np.ascontiguousarray(rows)))


def places(comm: Comm, rows: np.ndarray) -> np.ndarray:
    """Return the global index of each local row in the order of its last column, then the previous one and so on.

    Each rank sorts about as many rows as it has, those between two sampled limits (sample sort): the rows never
    are gathered on one rank. Equal rows keep the order of the ranks.

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
    for which, value in zip(sent, back, strict=True):
        result[which] = value
    return result


def _sorted(rows: np.ndarray) -> np.ndarray:
    """Return the order of rows by their last column, then the previous one and so on; often the last suffices."""
    order = np.argsort(rows[:, -1], kind="stable")
    last = rows[order, -1]
    return np.lexsort(rows.T) if np.any(last[1:] == last[:-1]) else order


def three_digits(value: float) -> float:
    """Return a value rounded down to three decimal digits, by 0.9 % at most.

    Rounding errors of an eigenvalue then have no effect on ranks. The third digit depends on the unit, of time for
    example (`docs/explanation/accuracy.md`).
    """
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(np.floor(value / unit * (1 + 1e-9)) * unit)
