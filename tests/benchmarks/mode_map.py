"""Time of the sliding-mode map: 180 runs of the impact demo on two cores with `ruptfx study`.

The study of ``demos/mode_map.toml`` from nothing, pictures of its page included. In short, 8 of its runs, whose time
per run and core is compared.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import tomli_w

import ruptfx
from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.many_runs.study import read_study
from ruptfx.platform import fem

STUDY = Path(ruptfx.__file__).with_name("demos") / "mode_map.toml"
CORES, RUNS, AIM = 2, 180, 250.0  # s
SOURCE = "aim, undisturbed machine"
SHORT = {"Sigma_0": 2, "V_imp": 2}  # values of each axis in short


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    """Time of the study by the clock; rows: runs, cores, seconds of the study, median seconds of a run."""
    if len(os.sched_getaffinity(0)) < CORES:
        raise RuptfxError(f"bench mode_map needs {CORES} cores")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "map")
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "ruptfx", "study", str(_study(fine, Path(folder))), "--out", str(out),
             "--cores", str(CORES), "--quiet"], capture_output=True, text=True, check=False, timeout=3600,
        )  # fmt: skip
        seconds = time.perf_counter() - began
        if done.returncode:
            raise RuptfxError(f"bench mode_map: {done.stderr.strip()[-2000:]}")
        results = [json.loads(path.read_text()) for path in (out / "points").glob("*/result.json")]
    failed = sum(result["status"] == "failed" for result in results)
    runs = len(results)
    of_run = sorted(result["seconds"] for result in results)[runs // 2]
    checks = [
        Check(f"mode map, {CORES} cores: runs", RUNS if fine else 8, runs - failed, 0, "1", "the study"),
        Check("mode map: seconds per run and core", AIM * CORES / RUNS, seconds * CORES / runs, 0, "s", SOURCE,
              "at most"),
    ]  # fmt: skip
    if fine:
        checks.append(Check(f"mode map of {RUNS} runs, {CORES} cores", AIM, seconds, 0, "s", SOURCE, "at most"))
    return Outcome(checks, None, [{"runs": runs, "cores": CORES, "seconds": seconds, "seconds_of_run": of_run}])


def _study(fine: bool, folder: Path) -> Path:
    """Return the file of the study, or of a shortened one."""
    if fine:
        return STUDY
    table: Table = read_study(STUDY, []).model_dump(mode="json", exclude_none=True)
    for axis in table["axes"]:
        axis["values"] = axis["values"][: SHORT.get(axis["name"])]
    short = folder / "short.toml"
    short.write_text(tomli_w.dumps(table))
    return short
