"""Processes that make the runs of an inference at once: children of the workers of a study, here or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError, Table
from ruptfx.input.schema import CaseError
from ruptfx.many_runs.inference.evaluations import Derivatives, Evaluation, file_of, load_one
from ruptfx.many_runs.inference.searches import AT_ONCE, COLUMNS_AT_ONCE
from ruptfx.many_runs.jobs import Client, answers, stoppable
from ruptfx.many_runs.jobs import opened as opened_cluster
from ruptfx.readings.misfits import Inference

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.platform import fem

Floats = NDArray[np.float64]
SERVER = "ruptfx.many_runs.inference.run_server"


class Pool:
    """Processes that make runs of an inference and write their files.

    Parameters
    ----------
    client : Client
        Of a dask cluster.
    out : Path
        Directory of the inference, which all workers see.
    memory : float
        Largest memory of the history of a run [bytes].
    ranks : int
        MPI ranks of each run.
    """

    def __init__(self, client: Client, out: Path, memory: float, ranks: int) -> None:
        self._client, self._out, self._memory, self._ranks = client, out, memory, ranks

    def make(
        self, runs: Mapping[int, Floats], derivatives: Derivatives, tell: Callable[[int], None] = lambda count: None
    ) -> list[Evaluation]:
        """Make runs at once, and return them in their order.

        Parameters
        ----------
        runs : mapping of int to ndarray, shape (n,)
            Variables by the number of the run.
        tell : callable
            Called with the number of finished runs.

        Raises
        ------
        RuptfxError
            A run has failed; finished ones are kept.
        """
        jobs: dict[int, Table] = {
            number: {
                "out": str(self._out), "number": number, "variables": z.tolist(), "derivatives": derivatives,
                "memory": self._memory,
            } for number, z in runs.items()
        }  # fmt: skip
        answers(self._client, jobs, self._ranks, SERVER, f"{self._out}-{derivatives}",
                lambda number, why: f"infer: run {number + 1} was lost ({why}); the same command repeats it",
                tell)  # fmt: skip
        return [load_one(file_of(self._out / "evaluations", number)) for number in runs]

    def columns(self, number: int, z: Floats, tell: Callable[[int], None] = lambda count: None) -> list[Floats]:
        """Make the tangent-linear sweeps of a Jacobian at once, and return its columns.

        A process that has not made the run makes it first.

        Parameters
        ----------
        number : int
            Of the run.
        z : ndarray, shape (n,)
            Its variables.
        tell : callable
            Called with the number of finished columns.

        Raises
        ------
        RuptfxError
            A sweep has failed.
        """
        jobs: dict[int, Table] = {
            column: {"out": str(self._out), "variables": z.tolist(), "column": column, "memory": self._memory}
            for column in range(len(z))
        }
        results = answers(self._client, jobs, self._ranks, SERVER, f"{self._out}-{number}-column",
                        lambda column, why: f"infer: the sensitivity of run {number + 1} to variable {column + 1} was "
                        f"lost ({why}); the same command repeats it", tell)  # fmt: skip
        return [np.array(results[column]["column"]) for column in range(len(z))]


@contextmanager
def opened(out: Path, memory: float, cores: int, ranks: int, scheduler: str | None) -> Iterator[Pool]:
    """Open the processes of an inference, and end them afterwards.

    Raises
    ------
    RuptfxError
        dask.distributed is missing, or the scheduler does not answer; after Ctrl-C or SIGTERM.
    """
    with interruptible(out), opened_cluster(out / "case.toml", scheduler, cores, ranks) as client:
        yield Pool(client, out, memory, ranks)


def interruptible(out: Path) -> AbstractContextManager[None]:
    """Let Ctrl-C and SIGTERM end an inference with the number of runs that are kept."""
    return stoppable(lambda: kept_runs(out))


def kept_runs(out: Path) -> str:
    """Return the number of runs that an inference has kept, for the message at its end."""
    return f"{len(list((out / 'evaluations').glob('*.npz')))} runs are kept, the same command continues"


def check_method(case: Case) -> None:
    """Refuse a pool where neither runs nor columns of a Jacobian are independent of each other.

    Raises
    ------
    CaseError
    """
    method = (case.inference or Inference()).method
    if method not in (*AT_ONCE, *COLUMNS_AT_ONCE):
        raise CaseError(
            f"inference.method = '{method}': makes one run after the other; use several ranks for each (--ranks), and "
            "neither --cores nor --scheduler, or method = 'gauss_newton', 'cma_es' or 'ensemble'"
        )


def check_ranks(comm: fem.MPI.Comm) -> None:
    """Refuse a pool where the ranks of this job make the runs.

    Raises
    ------
    RuptfxError
    """
    if comm.size > 1:
        raise RuptfxError(
            f"infer: {comm.size} ranks share this call; start it on one, which starts processes for the runs (--cores, "
            "--ranks, --scheduler)"
        )
