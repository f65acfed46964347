"""The line and the numbers that a run ends with."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ruptfx.input.quantities import with_prefix
from ruptfx.results.analysis.verdict import rows, verdict
from ruptfx.results.strength import closest_to_slip

CRACK = {
    "mode": "crack", "mode_before_arrest": "crack", "speed_regime": "sub-Rayleigh", "tip_speed": 1000.0,
    "tip_speed_error": 20.0, "tip_speed_over_c_R": 0.94, "tip_speed_over_c_s": 0.87, "not_resolved": None,
    "first_sliding": 31.7e-6, "peak_slip_rate": 0.95, "max_slip": 26.4e-6, "energy_closure": 0.002, "steps": 217,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, "crack, sub-Rayleigh, 0.94 c_R ± 0.02"),
        ({"tip_speed_over_c_R": None}, "crack, sub-Rayleigh, 0.87 c_s ± 0.02"),
        ({"tip_speed_error": None}, "crack, sub-Rayleigh, 0.94 c_R ± 0.01"),
        ({"mode": "not resolved", "not_resolved": "18 % of the energy from node to node"},
         "perhaps crack, sub-Rayleigh, 0.94 c_R ± 0.02, not resolved: 18 % of the energy from node to node"),
        ({"mode": "none", "first_sliding": None}, "never slipped"),
        ({"mode": "none"}, "no rupture ran along the interface"),
        ({"mode": None, "mode_missing": "two points"}, "no sliding mode: two points"),
        ({"mode": None, "first_peak_stress": 1.52e8, "events": 12, "fragments": 3},
         "first peak at 152 MPa, 12 facets failed, 3 pieces"),
        ({"mode": None, "events": 0}, "no facet failed"),
    ],
)  # fmt: skip
def test_a_line_says_what_was_found(changed: dict[str, Any], said: str) -> None:
    assert verdict(CRACK | changed) == said


def test_a_lumped_model_has_no_line() -> None:
    assert verdict({"kind": "spring_slider"}) == ""


def test_eight_numbers_with_units() -> None:
    assert rows(CRACK) == [
        ("first_sliding", "31.7 us"), ("peak_slip_rate", "950 mm/s"), ("max_slip", "26.4 um"),
        ("energy_closure", "0.2 %"), ("steps", "217"),
    ]  # fmt: skip
    more = {"max_opening": 1e-6, "pulse_width": 1.0, "healing_time": 1.0, "events": 3, "b_value": 1.0}
    assert len(rows(CRACK | more)) == 8


def test_each_of_several_interfaces_has_a_row() -> None:
    faults = {"far_fault": {"mode": "crack", "max_slip": 1.5, "moment": 3.2e18, "stress_drop": 2.5e6},
              "near": {"mode": "none", "max_slip": 0.0, "moment": 0.0}, "third": {"max_slip": 0.0}}  # fmt: skip
    *others, first, second, third = rows(CRACK | {"interfaces": faults})
    assert others == rows(CRACK)
    assert first == ("faults.far_fault", "crack, max slip 1.5 m, moment 3.2e+18 N m, stress drop 2.5 MPa")
    assert second == ("faults.near", "none") and third == ("faults.third", "no slip")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(31.7e-6, "s", "31.7 us"), (7.2e4, "Pa", "72 kPa"), (-3e-3, "m", "-3 mm"), (0.0, "m", "0 m"),
     (1e-12, "m", "0.001 nm"), (999.6, "m", "1 km"), (4e5, "s", "4e+05 s"), (2.5e12, "Pa", "2.5e+03 GPa"),
     (np.inf, "s", "inf s")],
)  # fmt: skip
def test_a_prefix_leaves_a_short_number(value: float, unit: str, text: str) -> None:
    assert with_prefix(value, unit) == text


def test_what_never_slipped_says_how_near_it_came(monkeypatch: pytest.MonkeyPatch) -> None:
    """Largest ratio of |shear traction| to strength: -3 / 12 at the second point and the second time."""
    from types import SimpleNamespace

    arrays = {
        "time": [0.0, 2e-6], "position": [0.0, 3e-3], "rupture_time": [np.inf, np.inf],
        "shear_traction": [[1.0, 2.0], [1.5, -3.0]],
    }  # fmt: skip
    data = {name: SimpleNamespace(values=np.array(values)) for name, values in arrays.items()}
    monkeypatch.setattr("ruptfx.results.strength.strength", lambda record, rows: np.full((2, 2), 12.0))
    record: Any = SimpleNamespace(interface=data)
    assert closest_to_slip(record) == "largest shear traction over strength 0.25 at 3 mm, 2 us"
    data["rupture_time"].values[0] = 1e-6
    assert closest_to_slip(record) == ""


def test_the_error_of_a_speed_over_a_wave_speed_is_that_of_the_ratio() -> None:
    """1000 +- 40 m/s and half of c_R: 0.50 +- 0.02."""
    assert "0.50 c_R ± 0.02" in verdict({
        "mode": "crack", "tip_speed": 1000.0, "tip_speed_error": 40.0, "tip_speed_over_c_R": 0.5,
    })  # fmt: skip
