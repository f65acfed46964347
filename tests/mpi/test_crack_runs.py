"""Bodies that break: the same bits on 1, 2 and 3 ranks, and of a run that was stopped and resumed on others."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from crack_cases import block

pytest.importorskip("dolfinx")

from ruptfx import fem
from ruptfx.case import read_case
from ruptfx.record import Record
from ruptfx.recording.checkpoint import Checkpoint

sys.path.insert(0, str(Path(__file__).parent))
from test_same_files import finish, start

pytestmark = [
    pytest.mark.fem, pytest.mark.mpi,
    pytest.mark.skipif(fem.MPI.COMM_WORLD.size > 1, reason="starts MPI jobs itself"),
]  # fmt: skip


def same(first: Path, second: Path) -> None:
    """Cracks, events and motion, to the last bit."""
    with Record(first) as a, Record(second) as b:
        assert a.events.sizes["event"] > 5
        assert a.events.identical(b.events) and a.cracks.identical(b.cracks)
        for name in ("points", "displacement", "velocity"):
            assert np.array_equal(a.bulk[name].values, b.bulk[name].values), name
        np.testing.assert_allclose(a.edges.to_array(), b.edges.to_array(), rtol=1e-9, atol=1e-6)
        for record in (a, b):
            assert abs(record.energy.closure).max() < 1e-12


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("case") / "block.toml"
    path.write_text(tomli_w.dumps(block({
        "damping": {"mass": 1e3, "kelvin_voigt": {"fraction": 0.1}}, "output.checkpoint_steps": 200,
    })))  # fmt: skip
    return path


@pytest.fixture(scope="module")
def alone(case_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("alone") / "run"
    code, text = finish(start(case_file, out, 1, "--quiet"))
    assert code == 0, text
    return out


@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_do_not_change_a_bit(ranks: int, case_file: Path, alone: Path, tmp_path: Path) -> None:
    code, text = finish(start(case_file, tmp_path / "run", ranks, "--quiet"))
    assert code == 0, text
    same(alone, tmp_path / "run")


@pytest.mark.faults
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_run_goes_on_from_its_checkpoint_to_the_same_bits(
    ranks: int, case_file: Path, alone: Path, tmp_path: Path
) -> None:
    """The run as it was when its last checkpoint had been written, and on one rank or two from there."""
    out = tmp_path / "run"
    shutil.copytree(alone, out)
    (out / "summary.json").unlink()
    found = Checkpoint.latest(fem.MPI.COMM_WORLD, out, read_case(case_file).hash)
    assert found is not None and 0 < found.manifest["time"] < 9e-6
    code, text = finish(start(case_file, out, ranks, "--quiet", "--resume"))
    assert code == 0, text
    same(alone, out)
