"""Catalogue of the events of a surface: numbers by hand."""

from __future__ import annotations

import numpy as np
import pytest
import xarray

from ruptfx.results.analysis.surface_events import row_of, surface_events


def record() -> xarray.Dataset:
    """Two points of 2 and 4 km2 at strike 0 and 3 km; the second slips 1.5 m at record 2, both at records 4 and 5."""
    time = np.array([0.0, 1e9, 1e9 + 10, 1e9 + 40, 3e9, 3e9 + 20, 3e9 + 60, 4e9])
    rate = np.array([[0, 0], [0, 1e-4], [0, 0.5], [0, 1e-4], [2e-3, 1.0], [0.3, 0.01], [0, 0.0], [0, 0.1]])
    slip = np.array([[0, 0], [0, 0], [0, 1.0], [0, 1.5], [0.2, 2.5], [0.8, 3.5], [1.0, 3.5], [1.0, 3.6]])
    shear = 10e6 - np.array([[0, 0], [0, 0], [0, 1e6], [0, 2e6], [0, 2e6], [1e6, 5e6], [1e6, 5e6], [1e6, 5e6]])
    none = ("time", "point"), np.zeros((8, 2))
    return xarray.Dataset({
        "slip_1": (("time", "point"), slip), "slip_2": none, "slip_rate_1": (("time", "point"), rate),
        "slip_rate_2": none, "shear_traction_1": (("time", "point"), shear), "shear_traction_2": none,
        "area": ("point", [2e6, 4e6]), "position": ("point", [0.0, 3e3]), "dip": ("point", [1e3, 2e3]),
    }, {"time": time}, {"shear_modulus_of_bodies": [30e9]})  # fmt: skip


def test_events_by_hand() -> None:
    """The third event goes on at the end of the record, and does not count."""
    first, second = surface_events(record())
    assert (first.first, first.last, first.time) == (1, 3, 1e9 + 10) and first.duration == pytest.approx(30.0)
    assert first.moment == pytest.approx(30e9 * 4e6 * 1.5) and first.area == 4e6 and first.slip == 1.5
    assert first.magnitude == pytest.approx((np.log10(1.8e17) - 9.1) / 1.5)
    assert first.stress_drop == pytest.approx(2e6) and first.centroid.tolist() == [3e3, 2e3]
    assert second.duration == pytest.approx(60.0) and second.peak_slip_rate == 1.0
    assert second.moment == pytest.approx(30e9 * (2e6 * 1.0 + 4e6 * 2.0)) and second.area == 6e6
    assert second.slip == pytest.approx(10 / 6) and second.largest_slip == 2.0
    assert second.stress_drop == pytest.approx((2 * 1.0 * 1e6 + 4 * 2.0 * 3e6) / 10)
    assert row_of(second)["strike"] == pytest.approx(8 / 10 * 3e3)


def test_no_event_below_the_threshold() -> None:
    assert surface_events(record(), 2.0) == []
