"""Pieces that meet: the same bits on 1, 2 and 3 ranks, and of a run that was stopped and resumed on others."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers.crack_cases import meeting_blocks
from helpers.whole_runs import run_of, run_on, starts_jobs, stopped

from ruptfx.case import read_case
from ruptfx.input.fields import ENERGIES
from ruptfx.platform import fem
from ruptfx.results.record import Record
from ruptfx.run.recording.checkpoint import Checkpoint

pytestmark = starts_jobs


def same(first: Path, second: Path) -> None:
    """Cracks and motion, to the last bit; energies and their closure to rounding."""
    with Record(first) as a, Record(second) as b:
        assert a.cracks.identical(b.cracks)
        for name in ("points", "displacement", "velocity"):
            assert np.array_equal(a.bulk[name].values, b.bulk[name].values), name
        for name in ENERGIES:
            theirs, mine = a.energy[name].values, b.energy[name].values
            assert np.abs(theirs - mine).max() < 1e-12 * a.energy.boundary_work.values.max(), name
        for record in (a, b):
            energy = record.energy
            assert all(energy[name].values.max() > 0 for name in ("frictional_dissipation", "collisions"))
            assert abs(energy["collision_loss"].values).max() > 0 and abs(energy.closure).max() < 1e-12


AGEING = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6,
          "theta_initial": 1.0}  # fmt: skip
case_file, alone = run_of(*(
    meeting_blocks({"output.checkpoint_steps": 300, **changes})
    for changes in ({}, {  # all other pairs rub by Coulomb's law
        "fracture.pairs": {"plate-stone": {"friction": AGEING}}, "damping": {"kelvin_voigt": {"fraction": 0.1}},
    }, {"fracture.kind": "extrinsic", "output.checkpoint_steps": 180, "damping": {"kelvin_voigt": {"fraction": 0.1}}})
), marks=pytest.mark.slow)  # fmt: skip


@pytest.mark.parametrize("ranks", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_ranks_do_not_change_a_bit(ranks: int, case_file: Path, alone: Path, tmp_path: Path) -> None:
    same(alone, run_on(ranks, case_file, tmp_path / "run"))


@pytest.mark.faults
def test_a_run_goes_on_from_its_checkpoint_to_the_same_bits(case_file: Path, alone: Path, tmp_path: Path) -> None:
    out = stopped(alone, tmp_path / "run")
    found = Checkpoint.latest(fem.MPI.COMM_WORLD, out, read_case(case_file))
    assert found is not None
    with h5py.File(found.path / "state.h5") as file:
        assert len(file["pairs/traction"]) > 0 and (file["cracks/hand_over"][()] == 2).any()
    same(alone, run_on(2, case_file, out, "--resume"))
