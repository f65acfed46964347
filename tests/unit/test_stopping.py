"""Runs that end early: after sliding has died, or when the tip has left the window."""

from __future__ import annotations

import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.small_cases import SETS, merged, plates

from ruptfx import simulate
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError

pytestmark = pytest.mark.fem


def impact(changes):
    constants = SETS["P1"]
    law = {"kind": "rate_and_state_power_law", "theta_0_initial": 2e-4}
    law |= {key: value for key, value in constants.items() if key != "L_p"}
    friction = {"kind": "prakash_clifton", "L_p": constants["L_p"], "theta_p_ratio": 0.02, "law": law}
    driven = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0}
    table = merged(plates(), {"faults.main.friction": friction, "boundaries": [driven], "duration": 20e-6})
    return parse_case(merged(table, changes))


def test_tip_beyond_a_position(tmp_path):
    full = simulate(impact({}), tmp_path / "full", progress=False)
    short = simulate(impact({"stop_when": {"tip_beyond": 6e-3}}), tmp_path / "short", progress=False)
    assert full.summary["ended_by"] == "duration" and short.summary["ended_by"] == "tip left the window"
    arrival = float(full.interface.rupture_time.sel(position=6e-3, method="nearest"))
    last = float(short.interface.time[-1])
    # Within one interval of the interface records, 1/300 of the duration, and one time step.
    assert arrival <= last <= arrival + 20e-6 / 300 + 2 * short.summary["time_step"]


def test_sliding_dead(tmp_path):
    # A short push of the initial shear stress: the boundary is at rest after 1 us, slip dies and stays dead.
    changes = {"boundaries": [], "faults.main.initial_stress.shear": {
        "kind": "boxcar", "inside": 0.2e6, "outside": 0.0, "center": 6e-3, "half_width": 1e-3}}  # fmt: skip
    case = impact({**changes, "stop_when": {"sliding_dead_for": 3e-6}, "duration": 200e-6})
    record = simulate(case, tmp_path / "out", progress=False)
    assert record.summary["ended_by"] == "sliding died"
    rate = abs(record.interface.slip_rate).max("position").values
    time = record.interface.time.values
    slid = time[rate > 1e-3]
    assert len(slid) and 3e-6 <= time[-1] - slid[-1] <= 3e-6 + 2 * 200e-6 / 300


def test_nothing_slides_is_not_dead(tmp_path):
    case = impact({"boundaries": [], "stop_when": {"sliding_dead_for": 1e-6}, "duration": 5e-6})
    assert simulate(case, tmp_path / "out", progress=False).summary["ended_by"] == "duration"


def test_a_window_that_no_point_can_leave(tmp_path):
    with pytest.raises(
        CaseError, match=facts(r"tip_beyond = 1: no interface reaches .*: faults.main from 0 to 0.012 m")
    ):
        simulate(impact({"stop_when": {"tip_beyond": 1.0}}), tmp_path / "out", progress=False)
