"""Runs of an interface that slides: the same on any number of ranks, the same bits after a restart."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w
from compare import largest_difference
from sliding_cases import rough

pytest.importorskip("dolfinx")

from ruptfx.case import read_case
from ruptfx.launch import find_mpiexec
from ruptfx.record import Record
from ruptfx.simulation import simulate

pytestmark = pytest.mark.fem

# Eight updates of who faces whom in about 400 steps, with impacts, friction and a viscous layer.
CHANGES = {
    "duration": 5e-6, "output.checkpoint_steps": 120, "output.interface_interval": 0.25e-6,
    "damping": {"mass": 1e5, "kelvin_voigt": {"fraction": 0.1}},
}  # fmt: skip


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("case") / "rubbing.toml"
    path.write_text(tomli_w.dumps(rough(CHANGES)))
    return path


@pytest.fixture(scope="module")
def alone(case_file: Path) -> Path:
    out = case_file.parent / "alone"
    simulate(read_case(case_file), out, progress=False)
    return out


@pytest.mark.parametrize("ranks", [2, 3])
def test_same_on_any_number_of_ranks(ranks: int, case_file: Path, alone: Path) -> None:
    """All ranks that own a part of the interface compute all its points, from the same bits."""
    out = case_file.parent / f"on_{ranks}"
    done = subprocess.run(
        [find_mpiexec(), "-n", str(ranks), sys.executable, "-m", "ruptfx", "run", str(case_file), "--out", str(out),
         "--quiet"], capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(Record(alone).interface.slip.max()) > 5e-6
    assert max(largest_difference(alone, out).values()) < 1e-9


def test_goes_on_with_the_same_bits(case_file: Path, alone: Path) -> None:
    """From the last checkpoint, in a new model: what points face is found again from the state alone."""
    out = case_file.parent / "resumed"
    shutil.copytree(alone, out)
    (out / "summary.json").unlink()
    assert len(list((out / "checkpoints").iterdir())) == 2
    simulate(read_case(case_file), out, progress=False, resume=True)
    assert max(largest_difference(alone, out).values()) == 0
