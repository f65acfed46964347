"""An error of one rank in any phase of a step reaches all ranks: none waits for messages that do not come."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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
