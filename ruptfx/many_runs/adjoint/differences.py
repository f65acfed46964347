"""Runs with changed unknowns at once, by the processes of a study: the differences that check a gradient."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING
from uuid import uuid4

from ruptfx import RuptfxError, Table
from ruptfx.many_runs.adjoint.unknowns import single_changes
from ruptfx.many_runs.jobs import answers, opened, stoppable

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.many_runs.adjoint.unknowns import Place
    from ruptfx.platform import fem
    from ruptfx.readings.misfits import Misfit

SERVER = "ruptfx.many_runs.adjoint.difference_server"


@contextmanager
def runs_at_once(
    case: Case, terms: Sequence[Misfit], cores: int, scheduler: str | None
) -> Iterator[Callable[[Sequence[tuple[Place, float]], Callable[[int], None]], list[float]]]:
    """Open the processes, and return what makes runs with changed unknowns and returns their objectives.

    Parameters
    ----------
    terms : sequence of Misfit
        Of the objective.
    cores : int
        Processes on this machine.
    scheduler : str or None
        Address of a dask scheduler, whose workers are used instead.

    Raises
    ------
    RuptfxError
        dask.distributed is missing, or the scheduler does not answer; after Ctrl-C or SIGTERM.
    """
    table = case.model_copy(update={"objective": list(terms)}).table()
    kept = "nothing of the gradient is kept"
    with stoppable(lambda: kept), opened(None, scheduler, cores, 1) as client:

        def make(changes: Sequence[tuple[Place, float]], tell: Callable[[int], None]) -> list[float]:
            jobs: dict[int, Table] = {
                number: {"case": table, "changes": [[each.key, value] for each, value in single_changes(place, change)]}
                for number, (place, change) in enumerate(changes)
            }
            results = answers(client, jobs, 1, SERVER, f"gradient-{uuid4().hex}", _lost, tell)
            return [results[number]["value"] for number in jobs]

        yield make


def check_use(check: bool, comm: fem.MPI.Comm) -> None:
    """Refuse processes for runs that a gradient does not make, or that the ranks of this job share.

    Raises
    ------
    RuptfxError
    """
    if not check:
        raise RuptfxError(
            "gradient: --cores and --scheduler are for the runs of --check; add --check, or use several ranks for the "
            "run and the sweep (--ranks)"
        )
    if comm.size > 1:
        raise RuptfxError(
            f"gradient: {comm.size} ranks share the runs of --check; leave out --cores and --scheduler, or start it on "
            "one rank"
        )


def _lost(number: int, why: str) -> str:
    return f"gradient: run {number + 1} of --check was lost ({why}); repeat the command"
