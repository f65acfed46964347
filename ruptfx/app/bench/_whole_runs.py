"""Timings that users notice: whole commands with default outputs, by phase."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from statistics import median

import tomli_w

import ruptfx
from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check
from ruptfx.app.bench._parts import Parts
from ruptfx.app.bench._timings import fault_case

IMPACT = Path(ruptfx.__file__).with_name("demos") / "impact.toml"
HEIGHT = 32.5e3  # m: 0.196 million nodes 100 m apart, 1670 steps in 9 s
LOOP = ("steps", "energies", "gathering", "writing")
SOURCE = "aim, undisturbed machine"

Seconds = dict[str, float]  # by phase


def whole_runs(fine: bool, parts: Parts) -> list[Table]:
    """Measure the wall-clock time of whole commands by phase; compare it with the time of the steps.

    Rows hold problem, ranks, phase, seconds, share (of the command); the phase `wall` is all of it. Medians of three
    runs, one when not fine.
    """
    samples = 3 if fine else 1
    rows: list[Table] = []
    entries: dict[tuple[str, int], list[Seconds]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cases = {"impact demo": IMPACT}
        for spacing, duration in ((100.0, 9.0), (50.0, 4.0)):
            name = f"fault problem, {spacing:g} m"
            cases[name] = Path(folder, f"{spacing:g}.toml")
            cases[name].write_text(tomli_w.dumps(fault_case(spacing, True, HEIGHT) | {"duration": duration}))
        for problem, case in cases.items():
            short = tomllib.loads(case.read_text())["duration"] / 20
            for ranks in (1, 2):
                with parts.one(f"{problem}, {ranks} rank{'s' * (ranks > 1)}"):
                    _run(case, Path(folder), ranks, "--set", f"duration={short}")  # compiles
                    entries[problem, ranks] = runs = [_run(case, Path(folder), ranks) for _ in range(samples)]
                    rows += _rows(problem, ranks, runs)
    parts.checks += _checks(entries)
    return rows


def _rows(problem: str, ranks: int, runs: list[Seconds]) -> list[Table]:
    seconds = {name: median(run[name] for run in runs) for name in runs[0]}
    total = seconds["wall"]
    return [
        {"problem": problem, "ranks": ranks, "phase": name, "seconds": value, "share": value / total}
        for name, value in seconds.items()
    ]


def _checks(table: dict[tuple[str, int], list[Seconds]]) -> list[Check]:
    """Return the checks of all aims that were measured."""
    checks = []

    def add(what: str, aim: float, values: list[float], unit: str = "s") -> None:
        if values:
            checks.append(Check(what, aim, median(values), 0, unit, SOURCE, "at most"))

    for problem, aim in (("fault problem, 100 m", 1.8), ("fault problem, 50 m", 1.3)):
        runs = table.get((problem, 1), [])
        add(f"{problem}: whole command over its steps", aim, [run["wall"] / run["steps"] for run in runs], "1")
    loops = [[sum(run[name] for name in LOOP) for run in table.get(("fault problem, 50 m", n), [])] for n in (1, 2)]
    if all(loops):
        speed_up = median(loops[0]) / median(loops[1])
        checks.append(
            Check("fault problem, 50 m: time loop on 1 rank over 2", 1.75, speed_up, 0, "1", SOURCE, "at least")
        )
    add("impact demo, 2 ranks, figures included", 4.0, [run["wall"] for run in table.get(("impact demo", 2), [])])
    runs = table.get(("fault problem, 100 m", 1), [])
    add("fault problem, 100 m: command to first step", 1.2, [run["start"] + run["model"] for run in runs])
    add("fault problem, 100 m: figures", 1.5, [run["figures"] for run in runs])
    return checks


def _run(case: Path, folder: Path, ranks: int, *options: str) -> Seconds:
    """Run one command and return its seconds by phase.

    Raises
    ------
    RuptfxError
        If the command fails, with its output.
    """
    with tempfile.TemporaryDirectory(dir=folder) as place:
        out = Path(place, "run")
        command = [sys.executable, "-m", "ruptfx", "run", str(case), "--ranks", str(ranks), "--out", str(out)]
        began = time.time()
        done = subprocess.run(
            [*command, "--quiet", *options], env=_environment(folder), capture_output=True, text=True, check=False,
            timeout=1800,
        )  # fmt: skip
        ended = time.time()
        if done.returncode:
            raise RuptfxError(f"bench speed, {case.stem}: {done.stderr.strip()[-2000:]}")
        return _phases(out, began, ended)


def _phases(out: Path, began: float, ended: float) -> Seconds:
    """Return the seconds by phase of a run between two times, from its log and the dates of its files."""
    text = next(line for line in (out / "run.log").read_text().splitlines() if "time by phase [s]: " in line)
    seconds: Seconds = json.loads(text.partition("time by phase [s]: ")[2])
    looped, complete = ((out / name).stat().st_mtime for name in ("run.log", "summary.json"))
    drawn = max(path.stat().st_mtime for path in (out / "figures").iterdir())
    seconds.pop("start", None)  # it began before the clock of the run
    return {
        "start": looped - began - sum(seconds.values()), **seconds,
        "end": complete - looped, "figures": drawn - complete, "exit": ended - drawn, "wall": ended - began,
    }  # fmt: skip


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of users: Python caches its bytecode, in a folder where that is allowed."""
    environment = dict(os.environ)
    if environment.pop("PYTHONDONTWRITEBYTECODE", None):
        environment["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
    return environment
