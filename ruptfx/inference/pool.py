"""Processes that make the runs of an inference at once: children of the workers of a study, here or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.inference.evaluations import Derivatives, Evaluation, file_of, load_one
from ruptfx.inference.searches import AT_ONCE
from ruptfx.misfits import Inference
from ruptfx.schema import CaseError
from ruptfx.study import workers
from ruptfx.study.cluster import Client, Interrupted, stoppable
from ruptfx.study.cluster import opened as opened_cluster

if TYPE_CHECKING:
    from ruptfx import fem
    from ruptfx.case import Case

Floats = NDArray[np.float64]
SERVER = "ruptfx.inference.run_server"


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
        derivatives : str
        tell : callable
            Called with the number of finished runs.

        Raises
        ------
        RuptfxError
            A run has failed; finished ones are kept.
        """
        from distributed import as_completed

        jobs = {
            self._client.submit(
                workers.on_child, self._ranks, {
                    "out": str(self._out), "number": number, "variables": z.tolist(), "derivatives": derivatives,
                    "memory": self._memory,
                }, None, SERVER, key=f"{self._out}-{number}-{derivatives}", pure=False, retries=0,
            ): number for number, z in runs.items()
        }  # fmt: skip
        for count, job in enumerate(as_completed(list(jobs)), 1):
            if (error := job.exception()) is not None:
                if isinstance(error, RuptfxError):
                    raise error
                lost = f"infer: run {jobs[job] + 1} was lost ({type(error).__name__}: {error})"
                raise RuptfxError(f"{lost}; the same command repeats it")
            answer = job.result()
            job.release()
            if answer["status"] != "done":
                raise RuptfxError(answer["error"])
            tell(count)
        return [load_one(file_of(self._out / "evaluations", number)) for number in runs]


@contextmanager
def opened(out: Path, memory: float, cores: int, ranks: int, scheduler: str | None) -> Iterator[Pool]:
    """Open the processes of an inference, and end them afterwards.

    Raises
    ------
    RuptfxError
        dask.distributed is missing, or the scheduler does not answer; after Ctrl-C or SIGTERM.
    """
    with stoppable(), opened_cluster(out / "case.toml", scheduler, cores, ranks) as client:
        try:
            yield Pool(client, out, memory, ranks)
        except KeyboardInterrupt:
            workers.close_children()
            kept = len(list((out / "evaluations").glob("*.npz")))
            raise Interrupted(f"stopped; {kept} runs are kept, the same command continues") from None


def check_method(case: Case) -> None:
    """Refuse a pool where runs depend on each other.

    Raises
    ------
    CaseError
    """
    method = (case.inference or Inference()).method
    if method not in AT_ONCE:
        raise CaseError(
            f"inference.method = '{method}': makes one run after the other; use several ranks for each (--ranks), and "
            "neither --cores nor --scheduler, or method = 'cma_es' or 'ensemble'"
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
