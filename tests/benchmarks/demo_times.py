"""Processor time of every demo with all its pictures, as the gallery gives it: cases and scripts, each run as a whole.

Each in a process of its own, on one rank; the load of the machine is kept with the time. Left out are studies, which
`ruptfx study` times itself, and searches that take hours. Without `--fine`: lumped models and demos of some seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import ruptfx
from benchmarks.command_cost import QUICK
from ruptfx import RuptfxError
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._parts import Parts
from ruptfx.case import Case, read_case
from ruptfx.lumped import LumpedModel

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

DEMOS = Path(ruptfx.__file__).with_name("demos")
# A module that draws the pictures of studies, not a run.
NO_SINGLE_RUNS = ("granite_figures.py", "impact_figures.py", "lecture_cases.py")


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    parts, rows = Parts(), []
    for path in sorted([*DEMOS.glob("*.toml"), *DEMOS.glob("*.py")]):
        if not wanted(path, fine):
            continue
        with parts.one(path.name):
            load = os.getloadavg()[0]
            seconds, wall = processor_time(path)
            rows.append({"demo": path.name, "seconds": seconds, "wall": wall, "load": load, "cores": os.cpu_count()})
            text = f"{seconds:.3g} s of processor time, {wall:.3g} s by the clock, load of {load:.2g} before"
            parts.checks.append(Check(f"{path.name}: ran to its end", 1.0, 1.0, source=text))
    return Outcome(parts.checks, rows=rows)


def wanted(path: Path, fine: bool) -> bool:
    """Return whether a file of the demos is a single run or a script, and not excluded."""
    if path.suffix == ".py":
        return fine and path.name not in NO_SINGLE_RUNS
    try:
        case = read_case(path)
    except RuptfxError:  # a study
        return False
    return isinstance(case, LumpedModel) or (isinstance(case, Case) and (fine or path.stem in QUICK))


def processor_time(path: Path) -> tuple[float, float]:
    """Return the processor time of a case or script with all its subprocesses, and the wall-clock time [s].

    Raises
    ------
    RuptfxError
        If it fails, with its output.
    """
    command = [str(path)] if path.suffix == ".py" else ["-m", "ruptfx", "run", str(path), "--quiet"]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as said:
        began = time.perf_counter()
        process = subprocess.Popen([sys.executable, *command], cwd=folder, stdout=said, stderr=said)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            raise RuptfxError(f"bench demo_times, {path.name}: {said.read().strip()[-2000:]}")
    return usage.ru_utime + usage.ru_stime, wall
