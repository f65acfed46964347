"""One MPI job that runs the points of a study: ``{"case": tables, "directory": path, "keep": [...]}``."""

from __future__ import annotations

from pathlib import Path

from ruptfx import Table
from ruptfx.case import Case, parse_case
from ruptfx.lumped import LumpedModel
from ruptfx.many_runs.jobs.server import Job, serve
from ruptfx.platform import fem
from ruptfx.run.simulation import simulate


def _run(job: Job, comm: fem.MPI.Comm) -> Table:
    case, out = parse_case(job["case"]), Path(job["directory"]) / "run"
    simulate(case if "run" in job["keep"] else _lean(case), out, comm, progress=False)
    values = _harvest(out, job["keep"]) if comm.rank == 0 else {}
    if "case_hash" in values:
        values["case_hash"] = case.hash
    return values


def _lean(case: Case | LumpedModel) -> Case | LumpedModel:
    """Return the case without stresses of the bodies: pictures of a run that is not kept show velocities only."""
    if not isinstance(case, Case) or "velocity" not in case.output.bulk_fields:
        return case
    return case.model_copy(update={"output": case.output.model_copy(update={"bulk_fields": ["velocity"]})})


def _harvest(out: Path, keep: list[str]) -> Table:
    from ruptfx.many_runs.study.harvest import harvest

    return harvest(out, keep)


if __name__ == "__main__":
    serve(_run)
