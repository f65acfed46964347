"""Program of a child: one MPI job that makes job after job.

Start-up (imports, compiled forms) is paid once, and a crash ends this process, not those that wait for its answers.
Rank 0 reads one job per line from standard input and answers each with one line on standard output; when the input
ends, because the parent has ended or was killed, the current job is dropped immediately.
"""

from __future__ import annotations

import gc
import json
import os
import queue
import sys
import threading
import traceback
from collections.abc import Callable

from ruptfx import RuptfxError, Table
from ruptfx.platform import fem
from ruptfx.run.simulation import Interrupted

Job = Table


class Jobs:
    """Queue of jobs on rank 0: tables, or null for the end."""

    def __init__(self) -> None:
        # Prints of libraries to standard output must not mix with the answers.
        self._answers = os.fdopen(os.dup(1), "w")
        os.dup2(2, 1)
        self._queue: queue.Queue[Job | None] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        for line in sys.stdin:
            self._queue.put(json.loads(line))
        os._exit(0)

    def next(self) -> Job | None:
        """Wait for the next job."""
        return self._queue.get()

    def answer(self, text: Table) -> None:
        """Send an answer."""
        self._answers.write(json.dumps(text) + "\n")
        self._answers.flush()


def serve(run: Callable[[Job, fem.MPI.Comm], Table]) -> None:
    """Run jobs until the job null arrives or the input ends.

    Parameters
    ----------
    run : callable
        Runs one job on all ranks, and returns values for the answer on rank 0.
    """
    comm = fem.MPI.COMM_WORLD
    jobs = Jobs() if comm.rank == 0 else None
    frozen = False
    while (job := comm.bcast(jobs.next() if jobs else None)) is not None:
        answer = _answer(run, job, comm)
        if jobs:
            jobs.answer(answer)
        gc.collect()  # frees the communicators of the meshes, of which MPI has a few thousand
        if not frozen:  # exclude all imports from garbage collection, which saves a tenth of a second
            gc.freeze()
            frozen = True


def _answer(run: Callable[[Job, fem.MPI.Comm], Table], job: Job, comm: fem.MPI.Comm) -> Table:
    """Return the answer to one job: status and values, or the error."""
    try:
        return {"status": "done", "values": run(job, comm)}
    except Interrupted as error:
        return {"status": "interrupted", "error": str(error)}
    except RuptfxError as error:
        return {"status": "failed", "error": str(error)}
    except Exception:
        if comm.size > 1:  # other ranks may wait for this one in a collective call
            traceback.print_exc()
            sys.stderr.flush()
            comm.Abort(1)
        return {"status": "failed", "error": traceback.format_exc(limit=-3).strip()}
