"""A study killed at random moments ends with the table of one that was left alone, and runs nothing twice."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import psutil
import pytest

from ruptfx.many_runs.study import read_csv
from ruptfx.many_runs.study.table import TIMINGS

pytestmark = [pytest.mark.fem, pytest.mark.slow, pytest.mark.faults]
pytest.importorskip("dolfinx")
ROOT = Path(__file__).parents[2]
STUDY = f"""
case = "{ROOT / "demos" / "impact.toml"}"
keep = []
[set]
duration = 8e-6
order = 2
mesh = {{ length = 40e-3, height = 20e-3, element_size = 4e-3 }}
[[axes]]
key = "faults.main.initial_stress.normal"
values = [1e6, 2e6, 3e6, 4e6, 5e6, 6e6, 7e6, 8e6]
[[axes]]
key = "boundaries.0.velocity"
values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
"""


def heed_ctrl_c() -> None:
    """Do not inherit an ignored SIGINT: shells that run tests in the background ignore it for all that they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture
def start(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "RUPTFX_TEST": str(tmp_path)}

    def launch(out: str) -> subprocess.Popen:
        command = [sys.executable, "-m", "ruptfx", "study", "study.toml", "--out", out, "--quiet"]
        with (tmp_path / f"{out}.err").open("w") as errors:
            return subprocess.Popen(
                command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=errors,
                preexec_fn=heed_ctrl_c,
            )  # fmt: skip

    return launch


def solvers(tmp_path: Path) -> list[psutil.Process]:
    """The solver processes of this test's studies."""
    found = []
    for process in psutil.process_iter(["cmdline", "environ"]):
        mine = (process.info["environ"] or {}).get("RUPTFX_TEST") == str(tmp_path)
        words = process.info["cmdline"]
        if mine and "ruptfx.many_runs.study.case_server" in words and "-n" not in words:
            found.append(process)
    return found


def test_ten_kills_change_nothing(tmp_path, start):
    assert start("calm").wait() == 0
    random.seed(1)
    for kill in range(10):
        process = start("wild")
        # Kills spread over the start, the first points and later ones.
        time.sleep(random.uniform(0.5, 6.0))
        process.send_signal(signal.SIGKILL)
        process.wait()
        deadline = time.monotonic() + 10
        while alive := solvers(tmp_path):
            assert time.monotonic() < deadline, f"kill {kill}: runs outlive their study: {alive}"
            time.sleep(0.1)
    assert start("wild").wait() == 0

    calm, wild = (read_csv(tmp_path / name / "table.csv") for name in ("calm", "wild"))
    assert len(calm) == 48
    for row in (*calm, *wild):
        for name in TIMINGS:
            row.pop(name, None)
    assert calm == wild
    log = Counter(line.split()[1] for line in (tmp_path / "wild" / "points.log").read_text().splitlines())
    # A kill between the rename and its line in the log may cost a line, never add one.
    assert max(log.values()) == 1 and len(log) >= 47


def test_a_crashing_solver_costs_one_point(tmp_path, start):
    process = start("out")
    while not (tmp_path / "out" / "points.log").is_file():
        time.sleep(0.05)
    solvers(tmp_path)[0].send_signal(signal.SIGSEGV)
    assert process.wait() == 0
    table = read_csv(tmp_path / "out" / "table.csv")
    failed = [row for row in table if row["status"] == "failed"]
    assert len(failed) == 1 and "the run crashed" in failed[0]["error"]


def test_ctrl_c_keeps_what_is_done_and_ends_at_once(tmp_path, start):
    process = start("out")
    while not (tmp_path / "out" / "points.log").is_file():
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20) == 130
    message = (tmp_path / "out.err").read_text()
    assert "the same command continues" in message and len(message.splitlines()) == 1, message
    done = len((tmp_path / "out" / "points.log").read_text().splitlines())
    assert 1 <= done < 48
    assert start("out").wait() == 0
    assert all(row["status"] == "done" for row in read_csv(tmp_path / "out" / "table.csv"))
