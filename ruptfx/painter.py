"""Figures of a run are drawn by processes of their own, which import what that takes while the run still computes.

`prepare` starts one where there is a core to spare; told by `look_at` that a run has its mesh, it sets up what pictures
of it share; asked by `draw`, it divides into as many as there are cores, and ends. Whoever has imported what draws
already, or has one core only, draws by itself.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx import RuptfxError, run_files

if TYPE_CHECKING:
    from ruptfx.record import Files

MOST = 4  # processes that draw: there are hardly more figures that take long
LONG = ("wavefield", "snapshots", "fringes")  # what takes longest is begun first
LATER = "RUPTFX_FIGURES"  # set by a launcher that draws when the ranks have ended

COMMAND = [sys.executable, "-m", __name__]

_waiting: subprocess.Popen[str] | None = None


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def prepare() -> None:
    """Let a process import what draws, if there is a core for it."""
    global _waiting
    if _waiting is None and "ruptfx.plots" not in sys.modules and cores() > 1:
        # A session of its own: Ctrl-C is for the run. It ends with its input, however this process ends.
        _waiting = subprocess.Popen(
            COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )


def start_up() -> Callable[[], float]:
    """Start such a process for nothing; what is returned waits for its end and tells its processor time [s]."""
    process = subprocess.Popen(COMMAND, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)

    def took() -> float:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        return usage.ru_utime + usage.ru_stime

    return took


def dismiss() -> None:
    """There is nothing to draw."""
    global _waiting
    if _waiting is not None:
        _waiting.kill()
        _waiting.communicate()
        _waiting = None


def look_at(out: Path) -> None:
    """The mesh of this run is in its files."""
    if _waiting is not None:
        assert _waiting.stdin is not None
        with suppress(OSError):  # it broke down; `draw` will do without it
            # Not through its buffer: what waited there would be an error when that is closed.
            os.write(_waiting.stdin.fileno(), (json.dumps(["look at", str(out.absolute())]) + "\n").encode())


def draw(out: Path) -> None:
    """Draw every figure of a complete run into ``figures/``.

    Raises
    ------
    RuptfxError
    """
    drawn = _drawn_by_others(out)
    if drawn is None:
        from ruptfx import plots
        from ruptfx.record import Files

        with Files(out, trust=True, checks=False) as record:  # the run of this command
            drawn = plots.save_all(record)
    run_files.add(out, drawn)


def _drawn_by_others(out: Path) -> list[Path] | None:
    """Return what the process that waits has drawn; None where there is none, or where it broke down."""
    global _waiting
    process, _waiting = _waiting, None
    if process is None:
        return None
    try:
        answer, _ = process.communicate(json.dumps(["draw", str(out.absolute())]) + "\n")
    except BaseException:
        process.kill()
        raise
    if not answer:
        return None
    drawn, error = json.loads(answer)
    if error is not None:
        raise RuptfxError(error)
    return [out / name for name in drawn]


# -- the process ---------------------------------------------------------------------------------------------------


def main() -> None:
    """Import, wait for a run, draw it, say what went wrong."""
    # Whatever prints to standard output must not reach the one who waits for the answer.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    from ruptfx import plots
    from ruptfx.figure_style import warm_up
    from ruptfx.record import Files

    warm_up()
    for line in sys.stdin:
        what, path = json.loads(line)
        if what == "draw":
            json.dump(_answer(Path(path)), answers)
            answers.flush()
            break
        with suppress(RuptfxError, OSError), Files(path) as record:
            plots.set_up(record)
    os._exit(0)  # somebody waits, and taking all imports apart takes long


def _answer(out: Path) -> tuple[list[str], str | None]:
    """Draw a run; names of the files in its directory, and what went wrong."""
    from ruptfx import plots

    try:
        drawn = _together(out, sorted(plots.FIGURES, key=lambda name: name not in LONG))
    except RuptfxError as error:
        return [], str(error)
    return [path.relative_to(out).as_posix() for path in drawn], None


def _together(out: Path, names: list[str]) -> list[Path]:
    """Draw those of these figures that suit a run, in as many processes as there are cores."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Forked, they have everything imported; nothing here has threads or open files of HDF5.
    with ProcessPoolExecutor(min(cores(), MOST), mp_context=get_context("fork")) as pool:
        submitted = [pool.submit(_draw_one, out, name) for name in names]
        return [path for drawn in submitted for path in drawn.result()]


def _draw_one(out: Path, name: str) -> list[Path]:
    from ruptfx import plots

    return plots.save_all(_record(out), only=[name])


@cache
def _record(out: Path) -> Files:
    """Of a process that draws several of its figures."""
    from ruptfx.record import Files

    return Files(out, trust=True, checks=False)  # the run of the command that waits


if __name__ == "__main__":
    main()
