"""An error of one rank reaches all ranks, in any phase of a step and where a rank has no elements."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.messages import facts
from helpers.small_cases import SPLIT, case
from helpers.whole_runs import starts_jobs

from ruptfx.platform.launch import find_mpiexec, mpi_environment

pytestmark = starts_jobs
PHASES = ("add_first", "add_with_elements", "add_internal", "add_external", "combine", "before_kick", "after_kick",
          "account")  # fmt: skip


def test_no_rank_hangs_where_another_one_fails(tmp_path: Path) -> None:
    """Two ranks, three kinds of contact, eight phases: rank 1 fails once, both raise the same and end."""
    job = Path(__file__).parent / "failing_ranks.py"
    done = subprocess.run(
        [find_mpiexec(), "-n", "2", sys.executable, str(job), str(tmp_path)], capture_output=True, text=True,
        check=False, timeout=240, env=mpi_environment(2),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    for rank in range(2):
        assert (tmp_path / f"rank_{rank}.txt").read_text(encoding="utf-8").splitlines() == [
            f"{name}: failed in {phase}: {rank} here"
            for name in ("faults", "intrinsic", "extrinsic") for phase in PHASES
        ]  # fmt: skip


def run_script(*lines: str) -> subprocess.CompletedProcess[str]:
    """Run a script on two ranks."""
    head = "from mpi4py import MPI; from ruptfx import RuptfxError; from ruptfx.app.script import begin; begin()"
    program = "\n".join([head, *lines])
    return subprocess.run(
        [find_mpiexec(), "-n", "2", sys.executable, "-c", program], capture_output=True, text=True, check=False,
        timeout=120, env=mpi_environment(2),
    )  # fmt: skip


def test_an_error_of_all_ranks_of_a_script_is_printed_once() -> None:
    done = run_script("raise RuptfxError('key = 3: at most 2')")
    assert done.returncode != 0 and done.stderr.count("error: key = 3: at most 2") == 1


def test_a_script_does_not_hang_where_one_rank_fails() -> None:
    """Rank 0 divides by zero; rank 1 waits for it in a barrier."""
    done = run_script("1 / MPI.COMM_WORLD.rank if MPI.COMM_WORLD.rank == 0 else MPI.COMM_WORLD.Barrier()")
    assert done.returncode != 0 and done.stderr.count("ZeroDivisionError") == 1


@pytest.mark.parametrize("length, ranks", [(1e-3, 2), pytest.param(4e-3, 8, marks=pytest.mark.slow)])
def test_ranks_without_elements(length: float, ranks: int, tmp_path: Path) -> None:
    """Two elements that face each other are one pair, for one rank. The number of ranks in the message works."""
    given = case({
        "order": 1, "duration": 1e-6, "faults.main.contact": SPLIT,
        "mesh": {"kind": "two_plates", "length": length, "height": 1e-3, "element_size": 1e-3},
    })  # fmt: skip
    file = tmp_path / "case.toml"
    file.write_text(given.to_toml(), encoding="utf-8")
    refused = run(file, ranks)
    said = refused.stdout + refused.stderr
    works = re.search(facts(rf"{ranks} ranks for {round(2e3 * length)} elements.*--ranks (\d+)"), said)
    assert refused.returncode != 0 and works is not None and "Traceback" not in said, said
    assert 1 <= int(works[1]) < ranks
    done = run(file, int(works[1]))
    assert done.returncode == 0, done.stderr


def run(file: Path, ranks: int) -> subprocess.CompletedProcess[str]:
    """Run a case on some ranks, from the command line."""
    return subprocess.run(
        [sys.executable, "-m", "ruptfx", "run", str(file), "--ranks", str(ranks), "--out",
         str(file.with_suffix(f".{ranks}"))], capture_output=True, text=True, check=False, timeout=240,
    )  # fmt: skip
