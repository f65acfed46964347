"""What a user waits for: whole commands with default outputs, by phase."""

from __future__ import annotations

import json
import runpy
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Literal

import tomli_w

import ruptfx
from ruptfx import RuptfxError, Table, fem, launch
from ruptfx.bench import Check
from ruptfx.bench._timings import fault_case
from ruptfx.stopwatch import phases

IMPACT = Path(ruptfx.__file__).with_name("demos") / "impact.toml"
HEIGHT = 32.5e3  # m: 0.196 million nodes 100 m apart, 1670 steps in 9 s
LOOP = ("steps", "energies", "gathering", "writing")
SOURCE = "aim, undisturbed machine"


def whole_runs(fine: bool) -> tuple[list[Table], list[Check]]:
    """Processor time of rank 0 by phase in whole commands, and how they compare with their steps.

    Rows hold problem, ranks, phase, seconds, share (of the processor time); the phase `wall` is the time by the clock.
    Medians of three runs, one when not fine; ranks that wait are busy, so that waiting counts.
    """
    samples = 3 if fine else 1
    rows: list[Table] = []
    found: dict[tuple[str, int], dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cases = {"impact demo": IMPACT}
        for spacing, duration in ((100.0, 9.0), (50.0, 4.0)):
            name = f"fault problem, {spacing:g} m"
            cases[name] = Path(folder, f"{spacing:g}.toml")
            cases[name].write_text(tomli_w.dumps(fault_case(spacing, True, HEIGHT) | {"duration": duration}))
        for problem, case in cases.items():
            for ranks in (1, 2):
                measured = [_run(case, Path(folder), ranks) for _ in range(1 + samples)][1:]  # the first compiles
                seconds = {name: median(run.get(name, 0.0) for run in measured) for name in measured[0]}
                found[problem, ranks] = defaultdict(float, seconds)
                total = sum(seconds.values()) - seconds["wall"]
                rows += [
                    {"problem": problem, "ranks": ranks, "phase": name, "seconds": value, "share": value / total}
                    for name, value in seconds.items()
                ]
    return rows, _checks(found)


def _checks(found: dict[tuple[str, int], dict[str, float]]) -> list[Check]:
    """The numbers that are aimed at."""
    checks = []

    def add(what: str, aim: float, value: float, unit: str, relation: Literal["at most", "at least"]) -> None:
        checks.append(Check(what, aim, value, 0, unit, SOURCE, relation))

    for problem, aim in (("fault problem, 100 m", 1.8), ("fault problem, 50 m", 1.3)):
        run = found[problem, 1]
        add(f"{problem}: whole command over its steps, CPU", aim, _total(run) / run["steps"], "1", "at most")
    one, two = (sum(found["fault problem, 50 m", ranks][name] for name in LOOP) for ranks in (1, 2))
    add("fault problem, 50 m: time loop on 1 rank over 2, CPU", 1.75, one / two, "1", "at least")
    add("impact demo, 2 ranks, figures included", 4.0, found["impact demo", 2]["wall"], "s", "at most")
    run = found["fault problem, 100 m", 1]
    add("fault problem, 100 m: command to first step, CPU", 1.2, run["start"] + run["model"], "s", "at most")
    add("fault problem, 100 m: figures, CPU", 1.5, run["figures"], "s", "at most")
    return checks


def _total(run: dict[str, float]) -> float:
    return sum(seconds for name, seconds in run.items() if name != "wall")


def _run(case: Path, folder: Path, ranks: int) -> dict[str, float]:
    """Seconds by phase of one command.

    Raises
    ------
    RuptfxError
        When it fails, with what it said.
    """
    with tempfile.TemporaryDirectory(dir=folder) as out:
        arguments = ["run", str(case), "--out", str(Path(out, "run")), "--quiet"]
        command = launch.mpi_command(ranks, "ruptfx.bench._whole_runs", *arguments)
        if ranks == 1:
            command = [sys.executable, "-m", "ruptfx.bench._whole_runs", *arguments]
        began = time.perf_counter()
        done = subprocess.run(
            command, env=launch.mpi_environment(ranks), capture_output=True, text=True, check=False, timeout=1800
        )
        wall = time.perf_counter() - began
    if done.returncode:
        raise RuptfxError(f"bench speed, {case.stem}: {done.stderr.strip()[-2000:]}")
    return {**json.loads(done.stdout.splitlines()[-1]), "wall": wall}


if __name__ == "__main__":
    try:
        runpy.run_module("ruptfx", run_name="__main__")
    except SystemExit as ended:
        if ended.code:
            raise
    if fem.MPI.COMM_WORLD.rank == 0:
        print(json.dumps(phases()))
