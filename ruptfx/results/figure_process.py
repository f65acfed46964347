"""Processes that draw the figures of a run; they import matplotlib while the run still computes.

`prepare` starts one process if there is a free core. `announce` announces the mesh of a run, of which the process
prepares the shared raster. `draw` requests the figures: the process forks into one per core, and ends. A process that
has imported matplotlib already, or has one core only, draws by itself.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx import RuptfxError
from ruptfx.platform import run_files
from ruptfx.platform.progress import in_lines

if TYPE_CHECKING:
    from ruptfx.results.record import Files

MOST = 4  # largest number of drawing processes: few figures take long
LONG = ("wavefield", "snapshots", "fringes")  # the slowest figures are started first
LATER = "RUPTFX_FIGURES"  # set by a launcher that draws after the ranks have ended

COMMAND = [sys.executable, "-m", __name__]

_waiting: subprocess.Popen[str] | None = None


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def prepare() -> None:
    """Start a process that imports matplotlib, if there is a core for it."""
    global _waiting
    if _waiting is None and "ruptfx.results.plots" not in sys.modules and cores() > 1:
        # Own session: Ctrl-C reaches the run only. The process ends when its input is closed, however this one ends.
        _waiting = subprocess.Popen(
            COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )


def start_up() -> Callable[[], float]:
    """Start such a process for a measurement; the returned function waits for its end and gives its time [s]."""
    process = subprocess.Popen(COMMAND, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)

    def took() -> float:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        return usage.ru_utime + usage.ru_stime

    return took


def dismiss() -> None:
    """End the waiting process without a figure."""
    global _waiting
    if _waiting is not None:
        _waiting.kill()
        _waiting.communicate()
        _waiting = None


def announce(out: Path) -> None:
    """Tell the waiting process that the files of this run contain its mesh."""
    if _waiting is not None:
        assert _waiting.stdin is not None
        with suppress(OSError):  # the process has failed; `draw` works without it
            # Unbuffered, because buffered data would raise an error when a broken pipe is closed.
            os.write(_waiting.stdin.fileno(), (json.dumps(["look at", str(out.absolute())]) + "\n").encode())


def draw(out: Path) -> None:
    """Draw every figure of a complete run into ``figures/``; where phases are lines, print a line for each.

    Raises
    ------
    RuptfxError
    """
    drawn = _drawn_by_others(out)
    if drawn is None:
        from ruptfx.results import plots
        from ruptfx.results.record import Files

        with Files(out, trust=True, checks=False) as record:  # trusted: the run of this command
            drawn = plots.save_all(record, saved=lambda path: _name(path, in_lines()))
    run_files.add(out, drawn)


def _drawn_by_others(out: Path) -> list[Path] | None:
    """Return the files drawn by the waiting process; None if there is none, or if it failed."""
    global _waiting
    process, _waiting = _waiting, None
    if process is None:
        return None
    try:
        what = "draw in lines" if in_lines() else "draw"
        answer, _ = process.communicate(json.dumps([what, str(out.absolute())]) + "\n")
    except BaseException:
        # With the processes that it has forked: they would wait for figures of a process that is gone.
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise
    if not answer:
        return None
    drawn, error = json.loads(answer)
    if error is not None:
        raise RuptfxError(error)
    return [out / name for name in drawn]


# -- the process ---------------------------------------------------------------------------------------------------


def main() -> None:
    """Import matplotlib, wait for a run, draw it, and report errors."""
    # Prints of libraries to standard output must not mix with the answer.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    from ruptfx.results import plots
    from ruptfx.results.figure_style import warm_up
    from ruptfx.results.record import Files

    warm_up()
    for line in sys.stdin:
        what, path = json.loads(line)
        if what.startswith("draw"):
            json.dump(_answer(Path(path), what == "draw in lines"), answers)
            answers.flush()
            break
        with suppress(RuptfxError, OSError), Files(path) as record:
            plots.set_up(record)
    os._exit(0)  # skips the slow clean-up of imports, because the parent process waits


def _answer(out: Path, lines: bool) -> tuple[list[str], str | None]:
    """Draw a run; return the names of its files, and the error message or None."""
    from ruptfx.results import plots

    try:
        drawn = _together(out, sorted(plots.FIGURES, key=lambda name: name not in LONG), lines)
    except RuptfxError as error:
        return [], str(error)
    return [path.relative_to(out).as_posix() for path in drawn], None


def _together(out: Path, names: list[str], lines: bool) -> list[Path]:
    """Draw those of the given figures that suit a run, in one process per core."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Forked processes share all imports; there are no threads and no open HDF5 files here.
    with ProcessPoolExecutor(min(cores(), MOST), mp_context=get_context("fork")) as pool:
        submitted = [pool.submit(_draw_one, out, name, lines) for name in names]
        return [path for drawn in submitted for path in drawn.result()]


def _draw_one(out: Path, name: str, lines: bool) -> list[Path]:
    from ruptfx.results import plots

    return plots.save_all(_record(out), only=[name], saved=lambda path: _name(path, lines))


def _name(path: Path, lines: bool) -> None:
    """Print the name of a figure that is written, so that a pipe is not silent while the others are drawn."""
    if lines:
        sys.stderr.write(f"  {path.name}\n")
        sys.stderr.flush()


@cache
def _record(out: Path) -> Files:
    """Return the record of a run, cached in a process that draws several figures."""
    from ruptfx.results.record import Files

    return Files(out, trust=True, checks=False)  # trusted: the run of the waiting command


if __name__ == "__main__":
    main()
