"""One MPI job that makes runs with changed unknowns, started by the workers of a comparison.

The model is built once; a job has the changes by their keys, and the answer has the objective.
"""

from __future__ import annotations

from ruptfx import Table
from ruptfx.case import Case, parse_case
from ruptfx.many_runs.adjoint.gradients import value_of_change
from ruptfx.many_runs.adjoint.unknowns import chosen
from ruptfx.many_runs.jobs.server import Job, serve
from ruptfx.platform import fem
from ruptfx.readings.misfits import Unknown
from ruptfx.run.model import Model


class Runs:
    """Makes the runs of one case after the other."""

    def __init__(self) -> None:
        self._known: Table = {}
        self._built: tuple[Case, Model] | None = None

    def __call__(self, job: Job, comm: fem.MPI.Comm) -> Table:
        """Make a run and return its objective; collective."""
        if self._built is None or job["case"] != self._known:
            case = parse_case(job["case"])
            assert isinstance(case, Case)
            self._known, self._built = job["case"], (case, Model(case, comm).in_steps("explicit"))
        case, model = self._built
        changes = dict(job["changes"])
        places = [place for _, place in chosen(model, [Unknown(key=key) for key in changes], case.objective)]
        single = list(zip(places, changes.values(), strict=True))
        return {"value": value_of_change(case, case.objective, model, single)}


if __name__ == "__main__":
    serve(Runs())
