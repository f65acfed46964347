"""Numbers of `events.h5` and `cracks.h5` against values computed by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.crack_cases import RUBS, WEAK, case
from helpers.units import check_units

from ruptfx import simulate
from ruptfx.laws.materials import WaveSpeeds
from ruptfx.results.record import Record
from ruptfx.run.recording.crack_files import CrackFiles, events

pytestmark = pytest.mark.fem

# One facet from (0, 0) to (4, 3) mm: n = (-0.6, 0.8), t = (0.8, 0.6), 5 mm long.
FACETS: dict[str, Any] = {
    "ends": np.array([[0, 0, 4e-3, 3e-3]]), "normal": np.array([[-0.6, 0.8]]), "length": np.array([5e-3]),
    "bodies": np.array([[1.0, 0.0]]), "joint": np.array([1.0]), "delta_n": np.array([10e-6]),
    "delta_s": np.array([24e-6]),
}  # fmt: skip
STATE: dict[str, Any] = {
    "time_of_failure": np.array([2e-6]), "time_of_yield": np.array([1e-6]), "time_of_gain": np.array([1.5e-6]),
    "energy_gain": np.array([5e-6]), "slip_at_failure": np.array([4e-6]), "largest_opening": np.array([[2e-6, 4e-6]]),
    "cohesive_slip": np.array([[5e-6, 7e-6]]),
}  # fmt: skip
BODIES, JOINTS = ["b", "a"], ["old", "vein"]


def test_every_column_of_an_event() -> None:
    """The facet opens by 3 um, slips by 4 um (6 um of cohesive slip) and is 10 mm thick."""
    table, words = events(STATE, FACETS, BODIES, JOINTS, 10e-3)
    n, t = np.array([-0.6, 0.8]), np.array([0.8, 0.6])
    potency = 5e-3 * (3e-6 * np.outer(n, n) + 4e-6 * 0.5 * (np.outer(n, t) + np.outer(t, n)))
    expected = {
        "time": 1.5e-6, "time_of_yield": 1e-6, "time_of_failure": 2e-6, "x": 2e-3, "y": 1.5e-3,
        "energy": 5e-8,  # 5e-6 J/m over 10 mm
        "magnitude": 2 / 3 * (np.log10(5e-8) - 4.8), "opening": 3e-6, "slip": 4e-6,
        "tensile_share": 0.3**2 / (0.3**2 + 0.25**2), "inclination": np.degrees(np.arctan(0.75)), "length": 5e-3,
        "potency_xx": potency[0, 0], "potency_yy": potency[1, 1], "potency_xy": potency[0, 1],
    }  # fmt: skip
    assert set(table) == set(expected)
    for name, value in expected.items():
        assert table[name][0] == pytest.approx(value, rel=1e-12), name
    assert words == {"mode": ["mixed"], "pair": ["a-b"], "joint": ["vein"]}


@pytest.mark.parametrize("end, angle", [((4e-3, -3e-3), 143.13), ((-4e-3, -3e-3), 36.87), ((-4e-3, 3e-3), 143.13)])
def test_the_inclination_of_a_facet_is_below_180_degrees(end: tuple[float, float], angle: float) -> None:
    table, _ = events(STATE, FACETS | {"ends": np.array([[0.0, 0.0, *end]])}, BODIES, JOINTS, 1.0)
    assert table["inclination"][0] == pytest.approx(angle, abs=0.01)


@pytest.mark.parametrize("tensile, mode", [(0.74, "mixed"), (0.76, "tensile"), (0.24, "shear"), (0.26, "mixed")])
def test_the_mode_of_an_event(tensile: float, mode: str) -> None:
    """Limits of the tensile share are 0.25 and 0.75: w / delta_n = sqrt(share), s / delta_s = sqrt(1 - share)."""
    jumps = {
        "largest_opening": np.full((1, 2), np.sqrt(tensile) * 10e-6),
        "cohesive_slip": np.full((1, 2), np.sqrt(1 - tensile) * 24e-6),
    }
    table, words = events(STATE | jumps, FACETS | {"joint": np.array([-1.0])}, BODIES, JOINTS, 1.0)
    assert table["tensile_share"][0] == pytest.approx(tensile, rel=1e-12)
    assert (words["mode"], words["joint"]) == ([mode], [""])


def test_an_aseismic_event_has_the_time_of_its_failure() -> None:
    table, _ = events(STATE | {"energy_gain": np.zeros(1)}, FACETS, BODIES, JOINTS, 1.0)
    assert table["time"][0] == 2e-6 and table["energy"][0] == 0 and table["magnitude"][0] == -np.inf


def test_every_field_of_a_snapshot(tmp_path: Path) -> None:
    """Means of two ends that differ, and the joint by its name."""
    ends = {
        "damage": [[1.0, 0.4]], "inelastic_opening": [[1e-6, 3e-6]], "slip": [[-2e-6, 6e-6]],
        "normal_traction": [[1e6, 2e6]], "shear_traction": [[4e6, -1e6]],
    }  # fmt: skip
    speeds = [WaveSpeeds(3e3, 2e3, 1.8e3), WaveSpeeds(4e3, 2.5e3, 2.3e3)]
    files = CrackFiles(tmp_path, FACETS, BODIES, speeds, JOINTS, 1.0)
    files.append(3e-6, STATE | {name: np.array(values) for name, values in ends.items()})
    files.close()
    (tmp_path / "case.toml").write_text("")
    with Record(tmp_path) as record:
        cracks = record.cracks
        assert [*cracks.attrs["c_s_of_bodies"], *cracks.attrs["c_R_of_bodies"]] == [2e3, 2.5e3, 1.8e3, 2.3e3]
        expected = {"status": 1, "damage": 0.7, "opening": 2e-6, "slip": 2e-6, "normal_traction": 1.5e6,
                    "shear_traction": 1.5e6}  # fmt: skip
        assert cracks.time.values.tolist() == [3e-6]
        for name, value in expected.items():
            assert cracks[name].values == pytest.approx(np.array([[value]]), rel=1e-12), name
        assert [str(cracks.attrs["joints"][number]) for number in cracks.joint.values] == ["vein"]
        assert [str(cracks.attrs["bodies"][number]) for number in cracks.bodies.values[0]] == ["a", "b"]
        assert record.events["joint"].values.tolist() == ["vein"]
    assert check_units(tmp_path) > 20


def test_snapshots_have_the_time_of_their_tractions(tmp_path: Path) -> None:
    """Tractions belong to the displacement before the last step, half a step before the velocities of the bodies."""
    with simulate(case({"duration": 2e-6, "output.bulk_interval": 1e-6}), tmp_path / "run", progress=False) as record:
        step = record.summary["time_step"]
        assert len(record.cracks.time) == 2
        np.testing.assert_allclose((record.bulk.time.values - record.cracks.time.values) / step, 0.5, rtol=1e-6)


def test_a_notch_has_no_failed_length(tmp_path: Path) -> None:
    """A plate with a notch of 3 mm that nothing breaks: no facet has failed."""
    pytest.importorskip("gmsh")
    mesh = {"kind": "specimen", "shape": {"kind": "rectangle", "width": 8e-3, "height": 8e-3}, "element_size": 1e-3,
            "notches": [[0.0, 0.0, 3e-3, 0.0]], "joints": {"vein": [-4e-3, 2e-3, 0.0, 2e-3]}}  # fmt: skip
    given = case({"mesh": mesh, "boundaries": [], "duration": 5e-7, "output.bulk_interval": 5e-7})
    with simulate(given, tmp_path / "run", progress=False) as record:
        failed = record.cracks.status.values[-1] == 2
        assert record.cracks.length.values[failed].sum() == pytest.approx(3e-3, rel=1e-9)
        assert record.summary["failed_length"] == 0.0
        assert record.cracks.length.values[record.cracks.joint.values == 0].sum() == pytest.approx(4e-3, rel=1e-9)
        assert [str(name) for name in np.atleast_1d(record.cracks.attrs["joints"])] == ["vein"]


def test_what_failed_is_counted_once(tmp_path: Path) -> None:
    """A bar that is torn: the length of its failed facets is that of its events."""
    brittle = {**WEAK, "G_Ic": 0.1, "G_IIc": 0.1}
    changes = {"fracture.default": {"cohesion": brittle, "friction": RUBS}, "fracture.unresolved": True}
    with simulate(case(changes), tmp_path / "run", progress=False) as record:
        failed = record.cracks.status.values[-1] == 2
        assert failed.any()
        expected = record.cracks.length.values[failed].sum()
        assert record.summary["failed_length"] == pytest.approx(expected, rel=1e-12)
