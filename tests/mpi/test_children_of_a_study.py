"""The runs of a study on several ranks end with the process that started them, also when that is killed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

pytest.importorskip("dolfinx")
pytestmark = [pytest.mark.fem, pytest.mark.faults]
STARTS = (
    "import time; from ruptfx.many_runs.jobs.children import Child; "
    "from ruptfx.many_runs.study.point_runs import SERVER; "
    "Child(2, SERVER); print('started', flush=True); time.sleep(600)"
)


def started_by(tmp_path: Path) -> list[psutil.Process]:
    """The processes of the study of this test that are alive, launcher and ranks."""
    found = []
    for process in psutil.process_iter(["environ", "status"]):
        mine = (process.info["environ"] or {}).get("RUPTFX_TEST") == str(tmp_path)
        if mine and process.info["status"] != psutil.STATUS_ZOMBIE:
            found.append(process)
    return found


def test_ranks_end_with_a_study_that_is_killed_while_they_start(tmp_path: Path) -> None:
    """They do not listen for the end of their input yet, as they are still importing: the kernel ends them."""
    study = subprocess.Popen(
        [sys.executable, "-c", STARTS], stdout=subprocess.PIPE, env={**os.environ, "RUPTFX_TEST": str(tmp_path)}
    )
    assert study.stdout is not None and study.stdout.readline() == b"started\n"
    deadline = time.monotonic() + 30
    while len(started_by(tmp_path)) < 4:  # the study, mpiexec and its ranks
        assert time.monotonic() < deadline
        time.sleep(0.01)
    study.kill()
    study.wait()
    killed = time.monotonic()
    while alive := started_by(tmp_path):
        assert time.monotonic() < killed + 1.5, f"outlive their study: {alive}"
        time.sleep(0.01)
