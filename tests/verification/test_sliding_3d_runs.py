"""Runs of solids that slide: the same on any number of ranks, the same bits after a restart, places and forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.sliding_cases import solids
from helpers.whole_runs import assert_goes_on_with_the_same_bits, run_of, run_on

pytest.importorskip("dolfinx")

from ruptfx.results.record import Record

pytestmark = pytest.mark.fem

CHANGES = {
    "duration": 3e-6, "output.checkpoint_steps": 15, "output.interface_interval": 0.25e-6,
    "faults.main.sliding.update_slip": 0.01, "damping": {"mass": 1e5, "kelvin_voigt": {"fraction": 0.1}},
    "mesh.upper.profile": {"kind": "sinusoid", "amplitude": 5e-6, "wavelength": 2e-3},
}  # fmt: skip

case_file, alone = run_of(solids(CHANGES))


def test_records_of_surfaces(alone: Path) -> None:
    """Slip is the way from the partners, forces are the sums of the points, and updates have been made."""
    with Record(alone) as record:
        data = record.interface
        time, area = data.time.values, data["area"].values
        slip = np.stack([data["slip_1"].values, data["slip_2"].values], axis=2)
        shear = [data[f"shear_traction_{k}"].values @ area for k in (1, 2)]
        normal, closed = data["normal_stress"].values @ area, data["normal_stress"].values[-1] > 0
        ends = [np.stack([data[f"{side}_{axis}"].values for axis in "xyz"], axis=2) for side in ("deformed", "paired")]
        paired = data["paired_position"].values
    assert slip.shape[2] == 2 and slip[-1, :, 0].max() > 10e-6 and slip[-1, :, 1].max() > 5e-6
    assert closed.any() and not closed.all()
    # Closed points touch their partners: the frames are those of the last update, 1 % of the distance of nodes ago.
    np.testing.assert_allclose(ends[0][-1, closed, 2], ends[1][-1, closed, 2], atol=1e-7)
    assert np.abs(paired[-1] - paired[0]).max() > 5e-6
    table = np.loadtxt(alone / "forces.csv", delimiter=",", skiprows=2)
    assert table.shape[1] == 10
    np.testing.assert_allclose(table[:, 0], time, rtol=1e-12)
    # Slopes of the lower, flat surface are those of its deformation.
    for column, force in zip((1, 2, 3), (normal, *shear), strict=True):
        np.testing.assert_allclose(table[:, column], force, atol=0.02 * normal.max())
    np.testing.assert_allclose(table[:, 4:8].sum(axis=1), 1.0, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 3])
def test_same_on_any_number_of_ranks(ranks: int, case_file: Path, alone: Path) -> None:
    out = run_on(ranks, case_file, case_file.parent / f"on_{ranks}")
    assert max(largest_difference(alone, out).values()) < 1e-9


def test_goes_on_with_the_same_bits(case_file: Path, alone: Path) -> None:
    assert_goes_on_with_the_same_bits(case_file, alone, checkpoints=2)
