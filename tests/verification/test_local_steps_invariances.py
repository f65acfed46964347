"""Local time steps of plates that are mirrored, turned, moved, renumbered, divided, and split over ranks."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.moved_cases import moved, placed
from helpers.run_data import Run, differences, read
from helpers.small_cases import plates

pytest.importorskip("dolfinx")

from helpers.whole_runs import run_on, write

from benchmarks import local_steps
from ruptfx.case import Case, parse_case
from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.steppers.local_leapfrog import LocalMotion

pytestmark = pytest.mark.fem

COLUMNS, THIN, SUBSTEPS = 14, 2, 5
CASE = plates({
    "order": 3, "duration": 7e-6, "plugins": [local_steps.__file__],
    "mesh": {"kind": "thin_columns", "columns": COLUMNS, "rows": 5, "thin": THIN},
    "faults.main.contact": {"kind": "split_node"}, "faults.main.initial_stress": {"normal": 6e6},
    "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 4e-6},
    "stepper": {"kind": "local_leapfrog", "substeps": SUBSTEPS, "time_step": 3.5e-8},
    "output.interface_interval": 0.7e-6, "output.bulk_interval": 3.5e-6,
    "boundaries": [
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 8.0, "ramp": 1e-6},
        {"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e6], "ramp": 2e-6},
        {"kind": "absorbing", "edge": "lower.right"},
    ],
})  # fmt: skip
"""An impact drives a rupture from the left end through the thin columns."""

MOTIONS: dict[str, tuple[Any, list[float], dict[str, Any]]] = {
    "a quarter turn": ([[0, -1], [1, 0]], [0.0, 0.0], {}),
    "mirrored": ([[-1, 0], [0, 1]], [0.0, 0.0], {}),
    "upside down": ([[1, 0], [0, -1]], [0.0, 0.0], {}),
    "moved": ([[1, 0], [0, 1]], [0.031, -0.017], {}),
    "renumbered": ([[1, 0], [0, 1]], [0.0, 0.0], {"seed": 5}),
    "in four bodies": ([[1, 0], [0, 1]], [0.0, 0.0], {"two_bodies": True}),
}


def run(table: dict[str, Any], out: Path) -> Run:
    case = parse_case(copy.deepcopy(table))
    assert isinstance(case, Case)
    simulate(case, out, progress=False)
    return read(out, "stress")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The run of the case as it is."""
    return run(CASE, tmp_path_factory.mktemp("local") / "run")


def test_the_rupture_crosses_elements_of_both_kinds(original: Run) -> None:
    case = parse_case(copy.deepcopy(CASE))
    assert isinstance(case, Case)
    motion = case.stepper.bind(Model(case, fem.MPI.COMM_SELF))
    assert isinstance(motion, LocalMotion) and motion.clusters.substeps == SUBSTEPS
    assert motion.clusters.share == THIN / COLUMNS and 0.3 < motion.clusters.fine.mean() < 0.8
    x, slip = original["interface.h5:x"].values, original["interface.h5:slip"].values
    beyond = x > (COLUMNS // 2 + 1) * local_steps.SIZE
    assert np.abs(slip[-1, beyond]).max() > 1e-6 and np.abs(slip[:5, beyond]).max() == 0.0


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in ("a quarter turn", "mirrored") else [pytest.mark.pairs])
             for name in MOTIONS]
)  # fmt: skip
def test_moved_plates_slip_in_the_same_way(name: str, original: Run, tmp_path: Path) -> None:
    matrix, offset, keys = MOTIONS[name]
    turn, shift = np.array(matrix, dtype=float), np.array(offset)
    table = moved(CASE, turn, shift, **keys)
    table["plugins"] += CASE["plugins"]
    actual = placed(run(table, tmp_path / "run"), np.eye(2), np.zeros(2))
    lines = list(differences(placed(original, turn, shift), actual, 1e-8, lambda each: each.endswith("h5:body")))
    assert not lines, "\n".join(lines)


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.skipif(fem.MPI.COMM_WORLD.size > 1, reason="starts MPI jobs itself")
def test_two_ranks_slip_in_the_same_way(original: Run, tmp_path: Path) -> None:
    two = read(run_on(2, write(tmp_path, CASE), tmp_path / "run"), "stress")
    lines = list(
        differences(
            placed(original, np.eye(2), np.zeros(2)),
            placed(two, np.eye(2), np.zeros(2)),
            1e-8,
            lambda each: each.startswith(("bulk.0", "bulk.1")),
        )
    )
    assert not lines, "\n".join(lines)
