"""Cost that `ruptfx check` predicts over that of `ruptfx run`: time, memory and files within 30 % for every demo.

Both in processes of their own, on one rank, with all outputs and pictures; processor time, so that other programs count
little, and memory together with the largest of the processes that draw. Demos of which more than some seconds are told
are compared over the part of their duration that should take these, and none ends before, as a rule of `stop_when` may
let it, which `check` cannot know. Where step sizes follow the state `check` tells
no time; such demos are compared over a small part, by memory alone. Without `--fine`: the demos of a few seconds.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import ruptfx
from ruptfx import RuptfxError
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._parts import Parts
from ruptfx.case import Case, read_case

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

DEMOS = Path(ruptfx.__file__).with_name("demos")
QUICK = ("antiplane", "gmsh", "impact", "rate_state", "pressed_block")
ALIKE = 0.3
LONGEST = 8.0  # s of predicted processor time; longer demos are shortened to it
ADAPTIVE = 0.02  # part of the duration of runs with adaptive steps, of which only memory is compared
UNITS = {"expected run time": "s, CPU", "memory": "MB", "files": "MB"}
# Prediction of `check` as JSON, and cost of a run in the last line of its output.
TOLD = """
import json, sys
from ruptfx.case import read_case
from ruptfx.app.checks.preflight import preflight
rows = {row.quantity: row.value for row in preflight(read_case(sys.argv[1], sys.argv[2:]))}
print(json.dumps({name: rows.get(name) for name in ("expected run time", "memory", "files")}))
"""
TAKEN = """
import atexit, json, resource, runpy, time
from ruptfx.run import cost

def tell():
    others = resource.getrusage(resource.RUSAGE_CHILDREN)  # the figure processes
    seconds = time.process_time() + others.ru_utime + others.ru_stime
    print(json.dumps([seconds, (cost.largest_memory() + 1024 * others.ru_maxrss) / 1e6]), flush=True)

atexit.register(tell)  # the command exits the process itself
runpy.run_module("ruptfx", run_name="__main__")
"""


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    parts = Parts()
    for path in sorted(DEMOS.glob("*.toml")):
        if not (fine or path.stem in QUICK) or not _is_run(path):
            continue
        with parts.one(path.stem):
            part, told, taken = compared(path)
            over = f", over {part:.2g} of its duration" * (part < 1)
            for what, unit in UNITS.items():
                value = told[what]
                if value is not None:
                    name, numbers = f"{path.stem}: {what}, told / taken", f"{value:.4g} over {taken[what]:.4g} {unit}"
                    parts.checks.append(Check(name, 1.0, value / taken[what], ALIKE, "1", numbers + over))
    return Outcome(parts.checks, rows=parts.rows)


def _is_run(path: Path) -> bool:
    try:
        return isinstance(read_case(path), Case)
    except RuptfxError:  # a study
        return False


def compared(path: Path) -> tuple[float, dict[str, float | None], dict[str, float]]:
    """Return processor time [s], memory and files [MB] of a case: predicted, and measured.

    The first value is the part of the duration that was run.

    Raises
    ------
    RuptfxError
        If one of the commands fails, with its output.
    """
    case = read_case(path)
    assert isinstance(case, Case)
    with tempfile.TemporaryDirectory() as folder:

        def told_of(part: float) -> tuple[list[str], dict[str, float | None]]:
            changes = _changes(case, part)
            return changes, json.loads(_last_line([TOLD, str(path), *changes], folder))

        part = ADAPTIVE if case.stepper.adaptive else 1.0
        changes, told = told_of(part)
        expected = told["expected run time"] or 0.0
        if expected > LONGEST:
            part = LONGEST / expected
            changes, told = told_of(part)
        options = [item for change in changes for item in ("--set", change)]
        taken = json.loads(_last_line([TAKEN, "run", str(path), "--out", "run", "--quiet", *options], folder))
        size = sum(file.stat().st_size for file in Path(folder, "run").rglob("*") if file.is_file())
    return part, told, dict(zip(UNITS, [*taken, size / 1e6], strict=True))


def _changes(case: Case, part: float) -> list[str]:
    """Return the overrides that shorten a case and its stages to a part of the duration, without `stop_when`."""
    changes = ["stop_when={}"] * (case.stop_when is not None)
    if part < 1:
        changes.append(f"duration={part * case.duration!r}")
        changes += [f"stages.{n}.duration={part * stage.duration!r}" for n, stage in enumerate(case.stages)]
    return changes


def _last_line(arguments: list[str], folder: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=3600
    )
    if done.returncode:
        raise RuptfxError(f"bench command_cost, {' '.join(arguments[1:])}: {done.stderr.strip()[-2000:]}")
    return done.stdout.splitlines()[-1]
