"""Fronts: arrival, tip, speeds and front tracking on fields whose answer is known."""

import numpy as np
import pytest
from helpers import synthetic

from ruptfx.results.analysis import front

TIME, POSITION = synthetic.times(), synthetic.points()
THRESHOLD = 0.04


def test_rupture_time_is_interpolated_between_saved_times():
    time = np.arange(4.0)
    # 10^(t - 2.3) passes 0.1 at t = 1.3. The second point never slides; the third slides from the start; the
    # fourth jumps from 0 at t = 1 to 5 at t = 2, which is taken to happen half-way.
    rate = np.column_stack([10 ** (time - 2.3), np.zeros(4), [1, 0, 0, 0], [0, 0, 5, 5]])
    np.testing.assert_allclose(front.rupture_time(rate, time, 0.1), [1.3, np.nan, 0.0, 1.5])


def test_sign_of_the_slip_does_not_matter():
    rate = synthetic.crack(TIME, POSITION)
    np.testing.assert_array_equal(front.rupture_time(-rate, TIME, THRESHOLD), front.rupture_time(rate, TIME, THRESHOLD))


def test_onsets_find_every_pulse():
    rate = synthetic.train(TIME, POSITION, count=4)
    column, when = front.onsets(rate, TIME, THRESHOLD)
    # At 10 mm the k-th front arrives at 5 us + k x 12 mm / 2100 m/s + 10 mm / 2100 m/s; the rate passes 0.04
    # of 2 m/s where 1 - s^2 = 0.02, that is (1 - 0.98995) x 3 mm = 0.03 mm behind the front.
    point = int(np.argmin(np.abs(POSITION - 0.01)))
    expected = 5e-6 + (np.arange(4) * 0.012 + POSITION[point] + 0.03e-3) / 2100
    np.testing.assert_allclose(when[column == point], expected, atol=np.diff(TIME)[0] / 2)


def test_tip_stays_before_the_first_point_that_never_slid():
    distance = np.arange(6.0)
    arrival = np.array([0.0, 1.0, 3.0, np.nan, 4.0, 5.0])
    tip = front.tip_position(arrival, distance, np.array([-1.0, 0.5, 2.0, 9.0]))
    # Half-way in time between arrivals is half-way between points; point 3 never slid, so 2 is the end.
    np.testing.assert_allclose(tip, [np.nan, 0.5, 1.5, 2.0])


def test_tip_jumps_where_a_point_ahead_slides_first():
    arrival = np.array([0.0, 3.0, 1.0, 2.0])
    # At t = 1 the tip is at 2 although point 1 slides later.
    assert front.tip_position(arrival, np.arange(4.0), np.array([1.0]))[0] == 2.0


@pytest.mark.parametrize("speed", [900.0, 2100.0])
def test_speed_of_noisy_arrivals_with_outliers(speed):
    rng = np.random.default_rng(1)
    x = np.linspace(0, 0.1, 400)
    noise = 1e-7
    t = 5e-6 + x / speed + rng.normal(0, noise, len(x))
    t[::20] += 2e-5  # twenty wrong arrivals
    t[7] = np.nan
    fit = front.fit_speed(x, t, 0.02, 0.09)
    # Standard error of a slope: s / sqrt(sum (x - mean)^2), n = 280 points over 70 mm: 1e-7 / (0.0202
    # sqrt(280)) = 2.96e-7 s/m, in speed times v^2: 1.3 m/s at 2100 m/s. Three of these are allowed.
    error = noise / np.sqrt(280) / (0.07 / np.sqrt(12)) * speed**2
    assert fit.value == pytest.approx(speed, abs=3 * error)
    assert fit.error == pytest.approx(error, rel=0.2)
    assert 0.02 <= fit.start < fit.stop <= 0.09


@pytest.mark.parametrize("rounding", [-1e-13, 0.0, 1e-13])
def test_points_at_the_ends_of_a_window_are_inside(rounding):
    """Five points at 1 to 5 m, the ends of the window: arrivals t = x^2 have the slope 6 s/m by symmetry about 3 m."""
    distance = np.arange(7.0) + rounding * np.array([0, -1, 0, 0, 0, 1, 0])
    found = front.fit_speed(distance, distance**2, 1.0, 5.0, outlier=100.0)
    assert found.points == 5 and found.value == pytest.approx(1 / 6, rel=1e-9)


def test_speed_needs_four_points():
    fit = front.fit_speed(np.arange(3.0), np.arange(3.0))
    assert np.isnan(fit.value) and fit.points == 3


def test_local_speed_sees_an_acceleration():
    # 1000 m/s up to 50 mm, then 2000 m/s; no arrival beyond 90 mm.
    x = synthetic.points()
    arrival = np.where(x < 0.05, x / 1000, 5e-5 + (x - 0.05) / 2000)
    arrival[x > 0.09] = np.nan
    local = front.local_speed(x, arrival, 5e-3)
    np.testing.assert_allclose(local[x < 0.047], 1000, rtol=1e-9)
    np.testing.assert_allclose(local[(x > 0.053) & (x <= 0.09)], 2000, rtol=1e-9)
    assert np.isnan(local[x > 0.09]).all()


def test_fronts_of_a_train_are_told_apart():
    # Three pulses, each slower than the one before it, hence never in touch.
    speeds = (2100.0, 1900.0, 1700.0)
    rate = synthetic.pulses(TIME, POSITION, lags=(0.0, 8e-6, 16e-6), speed=speeds)
    found = front.trace_fronts(rate, TIME, POSITION, THRESHOLD, slowest=200.0, min_length=0.02)
    fitted = [front.fit_speed(item.distance, item.time).value for item in found]
    np.testing.assert_allclose(fitted, speeds, rtol=2e-3)


def test_no_front_in_a_field_at_rest():
    rate = np.zeros((len(TIME), len(POSITION)))
    assert front.trace_fronts(rate, TIME, POSITION, THRESHOLD, slowest=200.0) == []
    assert np.isnan(front.rupture_time(rate, TIME, THRESHOLD)).all()


def test_a_front_that_dies_is_not_joined_to_its_neighbour():
    # The second pulse, 1.8 us behind, dies at 50 mm; its last point must not be linked to the first pulse's next.
    first = synthetic.pulses(TIME, POSITION, width=2e-3)
    second = synthetic.pulses(TIME, POSITION, lags=(1.8e-6,), width=2e-3) * (POSITION < 0.05)
    field = np.maximum(first, second)
    found = front.trace_fronts(field, TIME, POSITION, THRESHOLD, slowest=50.0, min_length=0.02)
    assert [item.distance[-1] for item in found] == pytest.approx([0.1, 0.05], abs=1e-3)
    assert all((np.diff(item.distance) > 0).all() for item in found)
