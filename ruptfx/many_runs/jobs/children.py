"""Child processes that make jobs and may crash, one MPI job per slot of a worker."""

from __future__ import annotations

import json
import logging
import os
import re
import select
import signal
import subprocess
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from ruptfx import RuptfxError, Table
from ruptfx.platform import launch

SHOWN = 8  # lines of output in the message about a crash
RECYCLE = 100  # runs after which a child is replaced, to limit memory leaks
_SIGNAL = re.compile(r"\(signal (\d+)\)")
_starter = ThreadPoolExecutor(1, "ruptfx-starter")
_idle: dict[tuple[str, int], list[Child]] = {}
_all: set[Child] = set()
_guard = threading.Lock()
_closing = threading.Event()


class ChildError(RuptfxError):
    """A child process ended before it answered."""


class Child:
    """One MPI job that makes run after run.

    Parameters
    ----------
    module : str
        Program of the job, which answers as `server.serve` does.
    """

    def __init__(self, ranks: int, module: str) -> None:
        self.ranks, self.served = ranks, 0
        self._output = b""
        self._strays: list[bytes] = []
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        # A session of its own: Ctrl-C is for this process, which then ends its children. They end with the thread that
        # starts them, hence one that lasts as long as this process, and not that of a task.
        self._process = _starter.submit(
            subprocess.Popen,
            launch.mpi_command(ranks, module), env=launch.mpi_environment(ranks), bufsize=0,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, start_new_session=True,
            preexec_fn=launch.ends_with_parent(),
        ).result()  # fmt: skip

    def run(self, job: Table, time_limit: float | None) -> Table:
        """Send one job and return its result.

        Parameters
        ----------
        time_limit : float or None
            Wall time [s].

        Raises
        ------
        ChildError
            The child crashed or exceeded the time limit; it has been ended.
        """
        assert self._process.stdin and self._process.stdout
        try:
            self._process.stdin.write(json.dumps(job).encode() + b"\n")
        except OSError:
            raise ChildError(self._how_it_ended()) from None
        deadline = time.monotonic() + (time_limit or 1e9)
        while (result := self._answer()) is None:
            if not select.select([self._process.stdout], [], [], max(0.0, deadline - time.monotonic()))[0]:
                self.close()
                raise ChildError(f"took longer than time_limit = {time_limit:g} s; increase it in the study")
            if not (part := os.read(self._process.stdout.fileno(), 1 << 16)):
                raise ChildError(self._how_it_ended())
            self._output += part
        self.served += 1
        return result

    def _answer(self) -> Table | None:
        """Return the first answer in the output so far; None without one.

        mpiexec itself prints to standard output when a rank aborts: lines that are no answer are kept for the message.
        """
        *lines, self._output = self._output.split(b"\n")
        for number, line in enumerate(lines):
            try:
                table = json.loads(line)
            except ValueError:
                table = None
            if isinstance(table, dict) and "status" in table:
                self._output = b"\n".join([*lines[number + 1 :], self._output])
                return table
            self._strays = [*self._strays[-SHOWN:], line]
        return None

    def _how_it_ended(self) -> str:
        """Return the signal or exit code of the child, with the end of its output."""
        self.close()
        code = self._process.returncode
        launcher = b"\n".join([*self._strays, self._output]).decode(errors="replace")
        # MPICH prints the number of the signal, Open MPI returns 128 and the number.
        number = int(printed[1]) if (printed := _SIGNAL.search(launcher)) else -code if code < 0 else code - 128
        how = signal.Signals(number).name if number in {each.value for each in signal.Signals} else f"exit code {code}"
        self._errors.seek(0)
        errors = self._errors.read().decode(errors="replace")
        words = [line for line in (errors.strip() or launcher).splitlines() if line.strip(" =|")]
        return f"the run crashed ({how}): " + " / ".join(words[-SHOWN:])[-1500:]

    def close(self) -> None:
        """End the job immediately."""
        assert self._process.stdin
        self._process.stdin.close()  # rank 0 exits at the end of its input
        try:
            self._process.wait(2)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


def on_child(module: str, ranks: int, job: Table, time_limit: float | None = None) -> Table:
    """Run one job on an idle child of this process, or a new one, and return its answer.

    Raises
    ------
    ChildError
        The child crashed or exceeded the time limit, or the work is stopping.
    """
    with _guard:
        if _closing.is_set():
            raise ChildError("the work is stopping")
        waiting = _idle.setdefault((module, ranks), [])
        child = waiting.pop() if waiting else Child(ranks, module)
        _all.add(child)
    try:
        result = child.run(job, time_limit)
    except ChildError:
        _all.discard(child)
        raise
    if child.served >= RECYCLE:
        child.close()
        _all.discard(child)
    else:
        with _guard:
            _idle[module, ranks].append(child)
    return result


def are_closing() -> bool:
    """Return whether the children have been closed, so that their last jobs do not count."""
    return _closing.is_set()


def close_children() -> None:
    """End all children of this process; their points are dropped, not recorded."""
    _closing.set()
    _report_errors(False)  # every dropped point would be reported
    with _guard:
        for child in list(_all):
            child.close()
        _all.clear()
        _idle.clear()


def open_for_work() -> None:
    """Allow children after `close_children`."""
    _closing.clear()
    _report_errors(True)


def _report_errors(wanted: bool) -> None:
    """Switch the error reports of dask on standard error on or off."""
    # tornado: a call that Ctrl-C interrupts at once is cancelled before it has begun; distributed does not expect that.
    for name in ("distributed.worker", "distributed.worker.state_machine", "tornado.application"):
        logging.getLogger(name).disabled = not wanted
