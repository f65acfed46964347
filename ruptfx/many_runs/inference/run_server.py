"""One MPI job that makes runs of an inference, started by the workers of its pool.

The model is built once; a job has the variables of a run, and the run is written to its file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ruptfx import Table
from ruptfx.case import Case, read_case
from ruptfx.many_runs.inference import evaluations
from ruptfx.many_runs.inference.evaluator import Evaluator
from ruptfx.many_runs.jobs.server import Job, serve
from ruptfx.platform import fem, parallel


class Runs:
    """Makes the runs of one inference after the other."""

    def __init__(self) -> None:
        self._known = ""
        self._evaluator: Evaluator | None = None

    def __call__(self, job: Job, comm: fem.MPI.Comm) -> Table:
        """Make a run and write its file, or return a column of the Jacobian of a run; collective."""
        out = Path(job["out"])
        evaluator = self._of(out, job["memory"], comm)
        if "column" in job:
            return {"column": evaluator.column(np.array(job["variables"]), job["column"]).tolist()}
        made = evaluator.evaluate(np.array(job["variables"]), job["derivatives"], first=job["number"] == 0)
        parallel.on_root(comm, lambda: evaluations.save(out / "evaluations", job["number"], made))
        return {}

    def _of(self, out: Path, memory: float, comm: fem.MPI.Comm) -> Evaluator:
        text = comm.bcast((out / "case.toml").read_text(encoding="utf-8") if comm.rank == 0 else None)
        if self._evaluator is None or text != self._known:
            case = read_case(out / "case.toml")
            assert isinstance(case, Case)
            self._known, self._evaluator = text, Evaluator(case, comm, memory)
        return self._evaluator


if __name__ == "__main__":
    serve(Runs())
