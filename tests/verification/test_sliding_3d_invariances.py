"""Solids that slide, turned about z, mirrored, upside down, renumbered, and with exchanged sides."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.moved_cases import moved, placed
from helpers.run_data import Run, differences, read
from helpers.sliding_cases import solids
from helpers.small_cases import merged

pytest.importorskip("dolfinx")

from ruptfx.case import Case, parse_case
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

MOTIONS: dict[str, tuple[Any, dict[str, Any]]] = {
    "a quarter turn": ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], {}),
    "half a turn": ([[-1, 0, 0], [0, -1, 0], [0, 0, 1]], {}),
    "mirrored along x": ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], {}),
    "mirrored along y": ([[1, 0, 0], [0, -1, 0], [0, 0, 1]], {}),
    "upside down": ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], {}),
    "a quarter turn about y": ([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], {}),
    "renumbered": (np.eye(3).tolist(), {"seed": 5}),
}
CASE = solids({
    "duration": 1.5e-6, "faults.main.contact": {"kind": "forward_lagrange", "tolerance": 1e-13, "sweeps": 300},
    "faults.main.sliding.update_slip": 0.01, "output.interface_interval": 0.3e-6, "instruments": [],
    "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.5, "mu_d": 0.2, "D_c": 2e-6},
    "stepper": {"kind": "leapfrog", "time_step": 2e-8},
})  # fmt: skip


def run(table: dict[str, Any], out: Path) -> Run:
    case = parse_case(copy.deepcopy(table))
    assert isinstance(case, Case)
    simulate(case, out, progress=False)
    return read(out, "solid")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The run of the case as it is: oblique motion over several updates of the pairing."""
    return run(CASE, tmp_path_factory.mktemp("sliding") / "run")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "a quarter turn" else [pytest.mark.pairs]) for name in MOTIONS]
)
def test_moved_solids_slide_in_the_same_way(name: str, original: Run, tmp_path: Path) -> None:
    matrix, keys = MOTIONS[name]
    turn, still = np.array(matrix, dtype=float), np.zeros(3)
    actual = placed(run(moved(CASE, turn, still, **keys), tmp_path / "run"), np.eye(3), still)
    lines = list(differences(placed(original, turn, still), actual, 1e-8))
    assert not lines, "\n".join(lines)


@pytest.mark.pairs
def test_exchanged_sides(tmp_path: Path) -> None:
    """Other points carry the contact under 20 MPa: mean pressing force and work of friction, within 3 %."""
    case = merged(CASE, {
        "duration": 4e-6, "faults.main.initial_stress": {"normal": 20e6}, "damping.kelvin_voigt.fraction": 0.2,
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}, "boundaries": CASE["boundaries"][:3],
        "initial_velocity": {"upper": [8.0, 6.0, 0.0]}, "output.interface_interval": 0.1e-6,
    })  # fmt: skip
    case["faults"]["main"]["friction"] = {"kind": "coulomb", "mu_d": 0.3}
    one = run(case, tmp_path / "one")
    other = run(moved(case, np.eye(3), np.zeros(3), exchanged=True), tmp_path / "other")
    for name in ("energy.csv:frictional_dissipation", "forces.csv:normal_force"):
        first, second = (float(np.mean(each[name].values)) for each in (one, other))
        assert second == pytest.approx(first, rel=0.03) and first > 0, name
