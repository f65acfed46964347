"""Catalogue of the events of an interface, and what a run with several of them says: numbers by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray

from ruptfx.results import analysis
from ruptfx.results.analysis.interface_events import fast_periods, front_speed, interface_events, peak_rates, row_of
from ruptfx.results.analysis.verdict import verdict


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
    first, second = interface_events(record())
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
    assert interface_events(record(), 2.0) == []


SPACING = 100.0  # m
LINE = SPACING * np.arange(41)
FIRST, SECOND = 500.0, 250.0  # m/s: fronts of two events, from one end to the other
YEARS = 31557600.0  # s
NO_MODE = "a mode is of one slip event, and the record has 2"


def cycles(every: float, surface: bool) -> xarray.Dataset:
    """Two events of slip 2 and 1 m, 30 years apart, from the left end to the right one, with creep of 3 m between.

    A surface is 41 x 11 points of the same, with 10 GPa and 4000 m x 1000 m.

    Parameters
    ----------
    every : float
        Time between records while a front runs [s].
    """
    x = np.repeat(LINE, 11) if surface else LINE
    times, slips, rates, base = [0.0], [0.0 * x], [0.0 * x], 0.0 * x
    for begin, speed, slip in ((100 * YEARS, FIRST, 2.0), (130 * YEARS, SECOND, 1.0)):
        for late in np.arange(-every, LINE[-1] / speed + 6.0, every):
            since = np.clip((late - x / speed) / 4.0, 0.0, 1.0)  # a point slides for 4 s
            times.append(begin + late)
            slips.append(base + slip * since)
            rates.append(np.where((since > 0) & (since < 1), slip / 4.0, 0.0))
        times.append(times[-1] + 1.0)
        slips.append(base + slip)
        rates.append(0.0 * x)
        base = base + slip + 1.5
    slips, rates = np.array(slips), np.array(rates)
    tangents = ("_1", "_2") if surface else ("",)
    fields = {"slip": slips, "slip_rate": rates, "shear_traction": 20e6 - 1e6 * slips}
    data = {
        f"{name}{tangent}": (("time", "point"), values if tangent != "_2" else 0 * values)
        for name, values in fields.items()
        for tangent in tangents
    }
    data |= dict.fromkeys(("opening",), (("time", "point"), 0 * rates))
    data["normal_stress"] = (("time", "point"), 50e6 + 0 * rates)
    data |= {"position": ("point", x), "rupture_time": ("point", 100 * YEARS + x / FIRST)}
    if surface:
        edge = np.where((x == 0) | (x == LINE[-1]), 0.5, 1.0)
        data |= {"dip": ("point", np.tile(SPACING * np.arange(11), 41)), "area": ("point", 1e4 * edge)}
        data["peak_slip_rate"] = ("point", rates.max(axis=0))
    speeds = {"c_R": 3100.0, "c_s": 3400.0, "c_p": 5900.0}
    return xarray.Dataset(data, {"time": times}, {"shear_modulus_of_bodies": [10e9], **speeds})


def summary_of(data: xarray.Dataset) -> dict[str, Any]:
    """Return the summary of a run with one interface."""
    record: Any = SimpleNamespace(interface=data, interfaces={"main": data}, path=Path("/nowhere"))
    return analysis.summarise(record)


def test_the_front_of_an_event_is_that_of_its_own_arrivals() -> None:
    """Rupture times are of the first event; of the second those between records, 0.2 s apart: 800 m in 3.2 s."""
    for surface in (False, True):
        data = cycles(0.2, surface)
        first, second = interface_events(data)
        assert front_speed(data, first) == (pytest.approx(FIRST, rel=1e-6), "")
        assert front_speed(data, second) == (pytest.approx(SECOND, rel=0.05), "")


def test_records_that_do_not_resolve_a_front_give_no_speed() -> None:
    """Records 2 s apart, in which the second front passes 500 m, more than the 400 m around a point."""
    data = cycles(2.0, surface=False)
    first, second = interface_events(data)
    assert front_speed(data, first)[0] == pytest.approx(FIRST, rel=1e-6)
    speed, reason = front_speed(data, second)
    assert np.isnan(speed) and reason == "records 2 s apart do not resolve it"
    at_once = data.assign(rupture_time=data["rupture_time"] * 0 + 100 * YEARS)
    assert front_speed(at_once, first) == (pytest.approx(np.nan, nan_ok=True), "most of it began to slide at once")
    thin = cycles(0.2, surface=True)
    thin = thin.isel(point=thin["dip"].values < 250.0)
    for name in ("slip_rate_1", "rupture_time"):  # of every other column of three points nothing slides
        thin[name] = thin[name].where(thin["position"] % 200.0 == 0, 0.0 if name == "slip_rate_1" else np.nan)
    assert front_speed(thin, interface_events(thin)[0])[1] == "it is only a few elements wide"


def test_a_short_pause_separates_no_events() -> None:
    """A shear wave needs 4000 / 3400 = 1.18 s along the line; a pause of 1 s is within an event, one of 2 s is not."""
    data = cycles(0.2, surface=False)
    peak = np.zeros(data.sizes["time"])
    begin = int(np.searchsorted(data["time"].values, 100 * YEARS))
    peak[[begin + 2, begin + 8, begin + 19]] = 1.0  # slow 0.2 s later, for 1.0 and 2.0 s
    assert fast_periods(data, peak) == [(begin + 2, begin + 9), (begin + 19, begin + 20)]


@pytest.mark.parametrize("surface", [False, True])
def test_a_run_of_several_events_speaks_of_events(surface: bool) -> None:
    """Of the whole record the slip is 4.5 m, with creep; mode, magnitude and front speed would be of no earthquake."""
    data = cycles(0.2, surface)
    summary = summary_of(data)
    assert (summary["slip_events"], summary["slip_events_complete"]) == (2, 2)
    assert summary["shortest_event_interval"] == summary["longest_event_interval"] == pytest.approx(30 * YEARS)
    assert summary["largest_event_time"] == pytest.approx(100 * YEARS)
    assert summary["largest_event_slip"] == pytest.approx(2.0)
    assert summary["largest_event_stress_drop"] == pytest.approx(2e6)
    assert summary["largest_event_front_speed"] == pytest.approx(FIRST, rel=1e-6)
    assert summary.get("mode") is None and summary.get("tip_speed") is None
    area = float(data["area"].sum()) if surface else np.nan
    magnitudes = [(np.log10(10e9 * area * slip) - 9.1) / 1.5 for slip in (1.0, 2.0)]
    shown = f"magnitudes {magnitudes[0]:.2f} to {magnitudes[1]:.2f}" if surface else "slip up to 2 m"
    assert verdict(summary) == f"2 slip events, {shown}, 30 yr apart, front of the largest at 500 m/s (median)"
    assert summary.get("mode_missing", NO_MODE) == NO_MODE
    bounds = [summary[f"{name}_event_magnitude"] for name in ("smallest", "largest")]
    assert bounds == (pytest.approx(magnitudes) if surface else [None, None])
    of_whole = {"moment_magnitude", "rupture_speed", "supershear_share", "stress_drop"}
    assert {name for name in of_whole if name in summary} == (of_whole if surface else set())
    assert not any(summary.get(name) for name in of_whole)
    assert summary.get("moment") == (pytest.approx(10e9 * area * 4.5) if surface else None)


def test_an_event_without_an_end_counts_and_has_no_numbers() -> None:
    data = cycles(0.2, surface=True)
    cut = data.isel(time=slice(0, int(np.argmax(peak_rates(data) > 0)) + 1))
    assert "slip_events" not in summary_of(cut)  # one event
    until = int(np.searchsorted(data["time"].values, 130 * YEARS)) + 5
    summary = summary_of(data.isel(time=slice(0, until)))
    assert (summary["slip_events"], summary["slip_events_complete"]) == (2, 1)
    assert summary["smallest_event_magnitude"] == summary["largest_event_magnitude"]
    assert "2 slip events, 1 of them complete, magnitude " in verdict(summary)
