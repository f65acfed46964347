"""Whole runs that several tests share: made once for a file of tests, on other ranks, stopped and gone on with."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import tomli_w

from helpers.compare import largest_difference

pytest.importorskip("dolfinx")

from ruptfx.case import Case, read_case
from ruptfx.platform import fem
from ruptfx.platform.launch import find_mpiexec
from ruptfx.run.recording.checkpoint import Checkpoint
from ruptfx.run.simulation import simulate

starts_jobs = [
    pytest.mark.fem, pytest.mark.mpi,
    pytest.mark.skipif(fem.MPI.COMM_WORLD.size > 1, reason="starts MPI jobs itself"),
]  # fmt: skip


def write(folder: Path, table: dict[str, Any]) -> Path:
    """The file of a case."""
    path = folder / "case.toml"
    path.write_text(tomli_w.dumps(table))
    return path


def run_of(*tables: dict[str, Any], marks: Any = ()) -> tuple[Any, Any]:
    """Two fixtures of a module, to be called `case_file` and `alone`: the file of each, and its run on one rank.

    Marks are those of all tests of any case but the first.
    """
    params = [pytest.param(table, marks=marks if number else (), id=str(number)) for number, table in enumerate(tables)]

    @pytest.fixture(scope="module", params=params)
    def case_file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
        return write(tmp_path_factory.mktemp("case"), request.param)

    @pytest.fixture(scope="module")
    def alone(case_file: Path) -> Path:
        out = case_file.parent / "alone"
        simulate(read_case(case_file), out, progress=False)
        return out

    return case_file, alone


def whole_and_resumed(given: Case, folder: Path, damaged: str = "") -> tuple[Path, Path]:
    """Run a case on all ranks; remove the end of a copy of that run, and compute it from its checkpoint."""
    comm = fem.MPI.COMM_WORLD
    whole, cut = folder / "whole", folder / "cut"
    simulate(given, whole, comm, progress=False)
    if comm.rank == 0:
        shutil.copytree(whole, cut)
        (cut / "summary.json").unlink()
        if damaged:
            (cut / damaged).write_bytes(b"cut off")
        shutil.rmtree(cut / "checkpoints" / "final")
    comm.barrier()
    checkpoint = Checkpoint.latest(comm, cut, given)
    assert checkpoint is not None and 0 < checkpoint.manifest["time"] < given.duration
    simulate(given, cut, comm, progress=False, resume=True)
    return whole, cut


def start(case: Path, out: Path, ranks: int, *options: str, launcher: bool = True) -> subprocess.Popen[str]:
    """`ruptfx run`, which starts mpiexec itself, or mpiexec by hand."""
    command = [sys.executable, "-m", "ruptfx", "run", str(case), "--out", str(out), *options]
    command = [*command, "--ranks", str(ranks)] if launcher else [find_mpiexec(), "-n", str(ranks), *command]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip


def finish(process: subprocess.Popen[str], limit: float = 120.0) -> tuple[int, str]:
    """Exit code and output; a hang is an error."""
    try:
        text, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        text, _ = process.communicate()
        pytest.fail(f"hangs: {text[-2000:]}")
    return process.returncode, text


def run_on(ranks: int, case: Path, out: Path, *options: str, limit: float = 120.0) -> Path:
    """The directory of a run that came to its end."""
    code, text = finish(start(case, out, ranks, "--quiet", *options), limit)
    assert code == 0, text
    return out


def killed(case: Path, out: Path, ranks: int, limit: float = 120.0) -> Path:
    """A run that was killed once it had written a checkpoint; one that was over before is an error."""
    process = start(case, out, ranks, "--quiet")
    deadline = time.monotonic() + limit
    while not list((out / "checkpoints").glob("step_*")):
        assert process.poll() is None and time.monotonic() < deadline, "over before it could be killed"
        time.sleep(0.005)
    kill_all(process)
    process.communicate(timeout=limit)
    assert not (out / "summary.json").exists(), "over before it could be killed"
    return out


def kill_all(process: subprocess.Popen[Any], limit: float = 120.0) -> None:
    """The launcher and the ranks, which Open MPI puts into groups of their own."""
    family = [*psutil.Process(process.pid).children(recursive=True), psutil.Process(process.pid)]
    for member in family:
        with suppress(psutil.NoSuchProcess):
            member.kill()
    psutil.wait_procs(family, timeout=limit)


def stopped(whole: Path, out: Path) -> Path:
    """A copy of a run as if it had been stopped: it goes on from its last checkpoint."""
    shutil.copytree(whole, out)
    (out / "summary.json").unlink()
    return out


def assert_goes_on_with_the_same_bits(case_file: Path, alone: Path, checkpoints: int) -> None:
    """From the last checkpoint, in a new model: what points face is found again from the state alone."""
    out = stopped(alone, case_file.parent / "resumed")
    assert len(list((out / "checkpoints").glob("step_*"))) == checkpoints
    simulate(read_case(case_file), out, progress=False, resume=True)
    assert max(largest_difference(alone, out).values()) == 0
    assert (out / "forces.csv").read_bytes() == (alone / "forces.csv").read_bytes()
