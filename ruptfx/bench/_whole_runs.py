"""What a user waits for: whole commands with default outputs, by phase."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import tomli_w

import ruptfx
from ruptfx import RuptfxError, Table, launch
from ruptfx.bench import Check
from ruptfx.bench._parts import Parts
from ruptfx.bench._speed_tables import OUTSIDE
from ruptfx.bench._timings import fault_case

IMPACT = Path(ruptfx.__file__).with_name("demos") / "impact.toml"
HEIGHT = 32.5e3  # m: 0.196 million nodes 100 m apart, 1670 steps in 9 s
LOOP = ("steps", "energies", "gathering", "writing")
SOURCE = "aim, undisturbed machine"

Seconds = dict[str, float]  # by phase


def whole_runs(fine: bool, parts: Parts) -> list[Table]:
    """Processor time of rank 0 by phase in whole commands; how they compare with their steps becomes checks.

    Rows hold problem, ranks, phase, seconds, share (of the processor time); the phase `wall` is the time by the clock.
    Medians of three runs, one when not fine; ranks that wait are busy, so that waiting counts.
    """
    samples = 3 if fine else 1
    rows: list[Table] = []
    found: dict[tuple[str, int], list[Seconds]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cases = {"impact demo": IMPACT}
        for spacing, duration in ((100.0, 9.0), (50.0, 4.0)):
            name = f"fault problem, {spacing:g} m"
            cases[name] = Path(folder, f"{spacing:g}.toml")
            cases[name].write_text(tomli_w.dumps(fault_case(spacing, True, HEIGHT) | {"duration": duration}))
        for problem, case in cases.items():
            for ranks in (1, 2):
                with parts.one(f"{problem}, {ranks} rank{'s' * (ranks > 1)}"):
                    _run(case, Path(folder), ranks)  # compiles
                    found[problem, ranks] = runs = [_run(case, Path(folder), ranks) for _ in range(samples)]
                    rows += _rows(problem, ranks, runs)
    parts.checks += _checks(found)
    return rows


def _rows(problem: str, ranks: int, runs: list[Seconds]) -> list[Table]:
    seconds = {name: median(run[name] for run in runs) for name in runs[0]}
    total = median(map(_total, runs))
    return [
        {"problem": problem, "ranks": ranks, "phase": name, "seconds": value, "share": value / total}
        for name, value in seconds.items()
    ]


def _checks(found: dict[tuple[str, int], list[Seconds]]) -> list[Check]:
    """The numbers that are aimed at, as far as they were measured."""
    checks = []

    def add(what: str, aim: float, values: list[float], unit: str = "s") -> None:
        if values:
            checks.append(Check(what, aim, median(values), 0, unit, SOURCE, "at most"))

    for problem, aim in (("fault problem, 100 m", 1.8), ("fault problem, 50 m", 1.3)):
        runs = found.get((problem, 1), [])
        add(f"{problem}: whole command over its steps, CPU", aim, [_total(run) / run["steps"] for run in runs], "1")
    loops = [[sum(run[name] for name in LOOP) for run in found.get(("fault problem, 50 m", n), [])] for n in (1, 2)]
    if all(loops):
        speed_up = median(loops[0]) / median(loops[1])
        checks.append(
            Check("fault problem, 50 m: time loop on 1 rank over 2, CPU", 1.75, speed_up, 0, "1", SOURCE, "at least")
        )
    clock = [run["wall"] for run in found.get(("impact demo", 2), [])]
    add("impact demo, 2 ranks, figures included, by the clock", 4.0, clock)
    runs = found.get(("fault problem, 100 m", 1), [])
    add("fault problem, 100 m: command to first step, CPU", 1.2, [run["start"] + run["model"] for run in runs])
    add("fault problem, 100 m: figures, CPU", 1.5, [run["figures"] for run in runs])
    return checks


def _total(run: Seconds) -> float:
    return sum(seconds for name, seconds in run.items() if name not in OUTSIDE)


def _run(case: Path, folder: Path, ranks: int) -> Seconds:
    """Seconds by phase of one command.

    Raises
    ------
    RuptfxError
        When it fails, with what it said.
    """
    with tempfile.TemporaryDirectory(dir=folder) as out:
        arguments = ["run", str(case), "--out", str(Path(out, "run")), "--quiet"]
        command = launch.mpi_command(ranks, "ruptfx.bench._timed_run", *arguments)
        if ranks == 1:
            command = [sys.executable, "-m", "ruptfx.bench._timed_run", *arguments]
        began = time.perf_counter()
        done = subprocess.run(
            command, env=launch.mpi_environment(ranks), capture_output=True, text=True, check=False, timeout=1800
        )
        wall = time.perf_counter() - began
    if done.returncode:
        raise RuptfxError(f"bench speed, {case.stem}: {done.stderr.strip()[-2000:]}")
    phases: Seconds = json.loads(done.stdout.splitlines()[-1])
    return phases | {"wall": wall}
