"""Runs on 1, 2 and 3 ranks through the command line: the same files, however many ranks; signals; one rank's error."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.messages import says
from helpers.small_cases import HOMALITE, INSTRUMENTS, blocks, impact, merged, plates, slip_weakening
from helpers.whole_runs import finish, start, starts_jobs, write

from ruptfx.platform.launch import find_mpiexec
from ruptfx.results.record import Record

pytestmark = starts_jobs

OUTPUT = {"interface_interval": 4e-7, "bulk_interval": 1e-6, "figures": False}
CASES = {
    "elastic": plates({
        "duration": 5e-6, "instruments": INSTRUMENTS, "faults.main.initial_stress": {"normal": 6e6, "shear": 1e5},
        "damping": {"mass": 1e4},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0, "ramp": 2e-6},
            {"kind": "absorbing", "edge": "lower.bottom"}, {"kind": "absorbing", "edge": "upper.right"},
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e6], "ramp": 2e-6},
        ],
    }),
    "slip_weakening": slip_weakening({"duration": 5e-6, "mesh.height": 4e-3}),
    "lecture_I": impact(6e6, 2.0, changes={"mesh.height": 4e-3, "mesh.length": 20e-3, "duration": 12e-6}),
    "implicit": impact(6e6, 2.0, changes={
        "order": 2, "mesh.height": 4e-3, "mesh.length": 20e-3, "duration": 12e-6,
        "instruments": [{**table, "interval": 10 * table["interval"]} for table in INSTRUMENTS],
        "stepper": {"kind": "generalized_alpha", "courant": 2.0},
    }),
    "held_along_x": plates({
        "duration": 5e-6, "order": 2, "faults.main.contact": {"kind": "split_node"},
        "mesh": {"kind": "inclined_plates", "side": 12e-3, "inclination": 0.35, "element_size": 2e-3},
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.5, "mu_d": 0.2, "D_c": 2e-6},
        "faults.main.initial_stress": {"normal": 6e6, "shear": 2.8e6},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0, "ramp": 2e-6},
            *({"kind": "driven", "edge": f"{body}.right", "component": "x", "velocity": 0.0}
              for body in ("upper", "lower")),
        ],
    }),
    "antiplane": plates({
        "plane": "antiplane", "duration": 4e-6, "faults.main.contact": {"kind": "split_node"},
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6},
        "faults.main.initial_stress.shear":
            {"kind": "boxcar", "inside": 3.7e6, "outside": 3e6, "center": 6e-3, "half_width": 2e-3},
    }),
}  # fmt: skip


def welded(folder: Path) -> dict[str, Any]:
    """Four blocks of two materials, welded but for the fault that crosses both."""
    pytest.importorskip("gmsh")
    sides = {"main": {"plus": ["c", "d"], "minus": ["a", "b"]}}
    soft = {**HOMALITE, "young_modulus": 3e9}
    return slip_weakening({
        "duration": 4e-6, "order": 3, "materials": {"default": HOMALITE, "b": soft, "d": soft},
        "mesh": blocks(folder, {"a": "1", "b": "2", "c": "3", "d": "4"}, {"main": "11, 21"}, sides),
        "positions": "x", "faults.main.initial_stress.shear.center": 0.0,
    })  # fmt: skip


def flat(text: str) -> str:
    """Without the line breaks of a narrow terminal."""
    return " ".join(text.split())


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name == "implicit" else pytest.mark.slow) for name in (*CASES, "welded")
])  # fmt: skip
def test_files_from_1_2_and_3_ranks(name: str, tmp_path: Path) -> None:
    table = CASES[name] if name in CASES else welded(tmp_path)
    case = write(tmp_path, merged(table, {"output": OUTPUT}))
    for ranks in (1, 2, 3):
        code, text = finish(start(case, tmp_path / str(ranks), ranks, "--quiet"))
        assert code == 0, text
    summaries = [json.loads((tmp_path / str(ranks) / "summary.json").read_text()) for ranks in (1, 2, 3)]
    assert [summary["ranks"] for summary in summaries] == [1, 2, 3]
    assert len({(s["steps"], s["time_step"], s["nodes"], s["case_hash"]) for s in summaries}) == 1
    for ranks in (2, 3):
        differences = largest_difference(tmp_path / "1", tmp_path / str(ranks))
        wrong = {key: value for key, value in differences.items() if not value < 1e-10}
        assert not wrong
    with Record(tmp_path / "2") as record:
        # Something happened: waves reached the interface, and where it can slip it did.
        assert abs(record.interface.shear_traction).max() > 1e5
        assert (record.interface.slip.max() > 1e-7) == (name != "elastic")


def test_mpiexec_by_hand(tmp_path: Path) -> None:
    case = write(tmp_path, plates({"duration": 1e-6}))
    code, text = finish(start(case, tmp_path / "run", 2, launcher=False))
    assert code == 0, text
    with Record(tmp_path / "run") as record:
        assert record.summary["ranks"] == 2


def test_wrong_mpiexec_is_noticed(tmp_path: Path) -> None:
    """Two ranks asked for, each alone: what happens when mpiexec is of another MPI library."""
    case = write(tmp_path, plates())
    done = subprocess.run(
        [sys.executable, "-m", "ruptfx", "run", str(case), "--out", str(tmp_path / "run")],
        capture_output=True, text=True, env={**os.environ, "RUPTFX_RANKS": "2"}, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    assert says("2 ranks were asked for, but mpi4py sees 1", flat(done.stderr))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("number, ranks", [
    pytest.param(number, ranks, id=f"{name}-{ranks}", marks=() if quick == ranks else pytest.mark.slow)
    for ranks in (1, 2) for name, number, quick in (("ctrl_c", signal.SIGINT, 2), ("sigterm", signal.SIGTERM, 1))
])  # fmt: skip
def test_stopped_by_a_signal(number: signal.Signals, ranks: int, tmp_path: Path) -> None:
    """Exit code 130, a message with the number of records, and files that can be read."""
    case = write(tmp_path, plates({"duration": 0.1, "output.interface_interval": 2e-6}))
    out = tmp_path / "run"
    process = start(case, out, ranks)
    log, deadline = out / "run.log", time.monotonic() + 60
    while not (log.exists() and "case" in log.read_text()):
        assert process.poll() is None and time.monotonic() < deadline, finish(process)
        time.sleep(0.1)
    time.sleep(0.5)
    # Ctrl-C goes to all processes of the terminal, SIGTERM to the one that was started.
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    code, text = finish(process, 30)
    assert code == 130, text
    with Record(out) as record:
        records = record.interface.sizes["time"]
        assert not record.complete and records >= 1
        assert np.isfinite(record.interface.slip.values).all()
        assert len(record.energy.time) == records
    # mpiexec may tell its ranks of a SIGTERM by a Ctrl-C.
    assert re.search(r"stopped by (Ctrl-C|SIGTERM) at", flat(text)) and f"{records} records are kept in" in flat(text)


@pytest.mark.parametrize("ranks", [1, 2])
def test_an_error_ends_all_ranks_with_one_message(ranks: int, tmp_path: Path) -> None:
    case = write(tmp_path, plates({"boundaries": [{"kind": "absorbing", "edge": "upper.botom"}]}))
    code, text = finish(start(case, tmp_path / "run", ranks))
    assert code == 1
    assert flat(text).count("boundaries.0.edge = 'upper.botom': no such edge") == 1
    assert "Traceback" not in text


BUGGY = """
import sys
from ruptfx.app import cli
from ruptfx.platform import fem
from ruptfx.interfaces.faults import fault_step as fault
step, comm = fault.FaultStep.__call__, fem.MPI.COMM_WORLD
def wrong(self, state, displacement, velocity, force, time):
    if comm.rank == comm.size - 1 and time > 8e-6:
        {what}
    return step(self, state, displacement, velocity, force, time)
fault.FaultStep.__call__ = wrong
sys.argv = ["ruptfx", "run", sys.argv[1], "--out", sys.argv[2]]
cli.app()
"""


@pytest.mark.parametrize("what, message, ranks", [
    pytest.param(*each, ranks, id=f"{name}-{ranks}", marks=[pytest.mark.slow] * (name == "nan" and ranks == 2))
    for ranks in (1, 2) for name, *each in (
        ("bug", "raise TypeError('a bug')", "TypeError: a bug"), ("nan", "velocity[:] = float('nan')", "not a number"),
    )
])  # fmt: skip
def test_what_goes_wrong_on_one_rank_ends_all(what: str, message: str, ranks: int, tmp_path: Path) -> None:
    """A bug shows its traceback, a motion that is not a number its place; nobody waits for a rank that is gone."""
    case = write(tmp_path, plates({"duration": 1e-3, "output.interface_interval": 1e-7}))
    script = tmp_path / "buggy.py"
    script.write_text(BUGGY.format(what=what))
    command = [sys.executable, str(script), str(case), str(tmp_path / "run")]
    if ranks > 1:
        command = [find_mpiexec(), "-n", str(ranks), *command]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    code, text = finish(process, 60)
    assert code != 0 and message in flat(text)
    with Record(tmp_path / "run") as record:
        assert not record.complete
        # Ranks that are aborted lose what waited in memory, less than 50 of the 80 records.
        assert record.interface.sizes["time"] >= 30
        assert np.isfinite(record.interface.slip_rate.values).all()
