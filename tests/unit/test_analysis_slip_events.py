"""Slip events of made records: what was put in is found again."""

import numpy as np
import pytest
import xarray

from ruptfx.results.analysis.slip_events import slip_events, speed_against_ratio

POINT = np.linspace(0.0, 0.1, 51)


def made() -> xarray.Dataset:
    """From 20 mm, to 60 mm at 500 m/s and to the left end at 200 m/s; a second later all from the left, at 1000 m/s."""
    times, rates, shear = [0.0, 1.0], [0 * POINT, 0 * POINT], [2e6 + 1e7 * POINT] * 2
    right = np.where(POINT <= 0.06, (POINT - 0.02) / 500, np.inf)
    for begin, arrival in ((1.5, np.where(POINT >= 0.02, right, (0.02 - POINT) / 200)), (3.0, POINT / 1000)):
        for late in np.arange(-1, 250) * 1e-6:
            times.append(begin + late)
            rates.append(np.where((late >= arrival) & (late < 200e-6), 0.3, 0.0))
            shear.append(shear[0] - 1e6 * (late >= arrival))
    fields = {"slip_rate": rates, "shear_traction": shear, "normal_stress": 5e6 + 0 * np.array(rates)}
    return xarray.Dataset(
        {name: (("time", "position"), np.array(values)) for name, values in fields.items()},
        {"time": times, "position": POINT},
    )


def test_events_are_found_with_their_ends_force_and_stress() -> None:
    one, two = slip_events(made(), 0.1)
    assert (one.start, two.start) == pytest.approx((1.5, 3.0), abs=2e-6)
    assert (one.origin, one.begin, one.reach) == pytest.approx((0.02, 0.0, 0.06))
    assert (two.origin, two.begin, two.reach) == pytest.approx((0.0, 0.0, 0.1))
    # The mean of 2 to 3 MPa over 100 mm; 1 MPa less on 60 mm, and half a spacing more by the rule of trapezoids.
    assert one.force == pytest.approx(2.5e5) and one.drop == pytest.approx(0.61e5, rel=0.01)
    assert one.before == pytest.approx((2e6 + 1e7 * POINT) / 5e6)
    assert slip_events(made(), 0.4) == []


def test_speeds_are_those_that_were_made_beside_the_stress_before() -> None:
    one, two = slip_events(made(), 0.1)
    ratio, speed = speed_against_ratio(one, POINT, 0.01, 0.01)
    # To the left from 10 to 20 mm away, to the right in three windows; the first of each side is skipped.
    # Records are 1 us apart, and a front at 500 m/s is in a window for 16 us.
    assert speed == pytest.approx([200, 500, 500, 500], rel=0.1)
    assert ratio == pytest.approx(0.4 + 2 * np.array([0.006, 0.034, 0.044, 0.054]), abs=0.003)
    assert speed_against_ratio(two, POINT, 0.02, 0.02)[1] == pytest.approx([1000] * 4, rel=0.1)


def test_where_no_front_can_be_told_there_is_no_speed() -> None:
    data = made()
    data["slip_rate"] = data.slip_rate * 0 + np.where(abs(data.time - 1.5) < 0.1, 0.3, 0.0)[:, None]  # all at once
    (event,) = slip_events(data, 0.1)
    assert all(len(found) == 0 for found in speed_against_ratio(event, POINT, 0.01, 0.01))


def test_the_drop_goes_from_the_record_before_to_the_one_after() -> None:
    """Shear traction 10, 9, 6, 4 Pa over 1 m, fast in the two middle records."""
    rate = np.array([0.0, 1.0, 1.0, 0.0])[:, None] * np.ones(2)
    shear = np.array([10.0, 9.0, 6.0, 4.0])[:, None] * np.ones(2)
    dims = ("time", "position")
    data = xarray.Dataset(
        {"slip_rate": (dims, rate), "shear_traction": (dims, shear), "normal_stress": (dims, 20 + 0 * rate)},
        {"time": [0.0, 1.0, 2.0, 3.0], "position": [0.0, 1.0]},
    )
    (event,) = slip_events(data, 0.5, pause=10.0)
    assert (event.force, event.drop) == pytest.approx((10.0, 6.0))
