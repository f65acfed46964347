"""Runs with a surface in three dimensions: the same files on 1 to 4 ranks, and after a kill."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import strike_slip
from helpers.whole_runs import finish, kill_all, start, starts_jobs, write

from ruptfx.results.record import Record

pytestmark = starts_jobs

CHANGES = {
    "duration": 3e-6, "output.checkpoint_steps": 10, "output.bulk_interval": 3e-6, "output.bulk_fields": ["velocity"],
    "instruments": [
        {"kind": "receiver", "name": "beside", "interval": 3e-7, "point": [1e-3, 1.3e-3, 0.0]},
        {"kind": "fault_receiver", "name": "fault", "interval": 3e-7, "point": [2.2e-3, 0.0, -3.1e-3]},
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("surface")
    case = write(folder, strike_slip(CHANGES))
    for ranks in (1, 2, 3, 4):
        code, text = finish(start(case, folder / str(ranks), ranks, "--quiet"))
        assert code == 0, text
    return folder


@pytest.mark.slow
def test_files_from_1_to_4_ranks(runs: Path) -> None:
    for ranks in (2, 3, 4):  # slabs; 4 ranks have blocks in x and z, whose edges cross the fault
        differences = largest_difference(runs / "1", runs / str(ranks))
        # The slip along the dip is rounding of the slip along strike here: it has no scale of its own.
        wrong = {key: value for key, value in differences.items() if not value < 1e-10}
        assert not wrong
    with Record(runs / "2") as record:
        data = record.interface
        assert data.sizes["time"] > 20 and data.slip_1.dims == ("time", "point")
        assert data.slip_1.max() > 1e-7 and np.isfinite(data.rupture_time).any()
        assert float(data.area.sum()) < 12e-3 * 8e-3  # without the rim
        summary = json.loads((runs / "2" / "summary.json").read_text())
        moment = 5.3e9 / 2.7 * float((data.area * np.hypot(data.slip_1, data.slip_2).isel(time=-1)).sum())
        assert summary["moment"] == pytest.approx(moment, rel=1e-9) and summary["energy_closure"] < 1e-12


@pytest.mark.slow
def test_the_moment_rate_is_that_of_every_step(runs: Path) -> None:
    """At the records it is that of the fields; its integral is the moment; ranks do not matter."""
    with Record(runs / "1") as record, Record(runs / "3") as other:
        data, table = record.interface, record.moment_rate
        time, rate = table["time"].values, table["main"].values
        assert len(time) == record.summary["steps"] and (np.diff(time) > 0).all()  # the first step completes the start
        speed = np.hypot(data.slip_rate_1, data.slip_rate_2)
        expected = 5.3e9 / 2.7 * (data.area * speed).sum("point").values
        rows = [int(np.argmin(np.abs(time - each))) for each in data.time.values]
        np.testing.assert_allclose(rate[rows], expected, atol=1e-9 * expected.max())
        # Slip is the sum of the slip rates over the steps; no point turns.
        assert np.trapezoid(rate, time) == pytest.approx(record.summary["moment"], rel=0.02)
        np.testing.assert_allclose(other.moment_rate["main"], rate, atol=1e-10 * rate.max())
        assert table["main"].attrs["units"] == "N m/s"


def runs_agree(case: Path, folder: Path) -> None:
    """Run a case on 1 and 2 ranks, in folders of these names, and compare the files."""
    for ranks in (1, 2):
        code, text = finish(start(case, folder / str(ranks), ranks, "--quiet"))
        assert code == 0, text
    differences = largest_difference(folder / "1", folder / "2")
    assert not {key: value for key, value in differences.items() if not value < 1e-10}


def test_a_half_gives_the_same_files_on_1_and_2_ranks(tmp_path: Path) -> None:
    rest = [{"kind": "driven", "edge": "plus.plane", "component": each, "velocity": 0.0} for each in "xz"]
    case = write(tmp_path, strike_slip({**CHANGES, "mesh.half": True, "boundaries": rest}))
    runs_agree(case, tmp_path)
    with Record(tmp_path / "2") as record:
        # 12 x 8 elements of order 2 without the welded rim: half a sixth of an element less on three sides.
        assert float(record.interface.area.sum()) == pytest.approx((12 - 1 / 3) * (8 - 1 / 6) * 1e-6)
        assert record.interface.slip_1.max() > 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_killed_run_goes_on_to_the_same_bits(ranks: int, runs: Path, tmp_path: Path) -> None:
    case = write(tmp_path, strike_slip(CHANGES))
    process, deadline = start(case, tmp_path / "run", ranks, "--quiet"), time.monotonic() + 120
    while not list((tmp_path / "run" / "checkpoints").glob("step_*")) and time.monotonic() < deadline:
        assert process.poll() is None, "the run ended before it could be stopped"
        time.sleep(0.005)
    kill_all(process)
    code, text = finish(start(case, tmp_path / "run", ranks, "--quiet", "--resume"))
    assert code == 0, text
    differences = largest_difference(runs / str(ranks), tmp_path / "run")
    # Of the energies, `impact_loss` is rounding here, 1e-18 of the work: the normal of this fault does not move.
    assert differences.pop("energy.csv") < 1e-16
    assert max(differences.values()) == 0
    one, other = ((folder / "moment_rate.csv").read_text() for folder in (runs / str(ranks), tmp_path / "run"))
    assert one == other and len(one.splitlines()) == 2 + 31


@pytest.mark.slow
def test_a_rough_fault_under_a_tensor_is_the_same_on_2_ranks(tmp_path: Path) -> None:
    height = {
        "kind": "self_affine_surface", "rms": 1e-4, "hurst": 0.7, "length": 16e-3, "longest": 8e-3, "shortest": 3e-3,
        "seed": 2,
    }  # fmt: skip
    table = strike_slip({**CHANGES, "instruments": [], "mesh.height": height})
    del table["faults"]["main"]["initial_stress"]
    table["initial_stress"] = {"kind": "uniform", "tensor": [-5e6, -6e6, -5e6, 3.0e6, 0.0, 0.0]}
    table["faults"]["main"]["nucleation"] = {
        "kind": "smooth_patch", "extra": 2e6, "radius": 2.5e-3, "rise": 5e-7,
        "center": {"x": 0.0, "y": 0.0, "z": -3e-3},
    }  # fmt: skip
    case = write(tmp_path, table)
    runs_agree(case, tmp_path)
    with Record(tmp_path / "2") as record:
        assert np.ptp(record.interface.shear_traction_1.isel(time=0).values) > 1e4
        assert record.interface.slip_1.max() > 1e-8
        data = record.interface
        centre = np.argmin(np.hypot(data.position, data.z + 3e-3).values)  # 1 / (1 - (r / R)^2) less 1 in the exponent
        assert np.hypot(data.added_shear_1, data.added_shear_2).values[centre] == pytest.approx(2e6, rel=0.05)
        fallen = (data.shear_traction_1[0] + data.added_shear_1 - data.shear_traction_1[-1], data.shear_traction_2[0]
                  + data.added_shear_2 - data.shear_traction_2[-1])  # fmt: skip
        slip = (data.slip_1[-1], data.slip_2[-1])
        drop = (data.area * (fallen[0] * slip[0] + fallen[1] * slip[1])).sum() / (data.area * np.hypot(*slip)).sum()
        assert record.summary["stress_drop"] == pytest.approx(float(drop), rel=1e-9) and drop > 0
