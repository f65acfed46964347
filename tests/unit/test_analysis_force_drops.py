"""Ramps, knees and drops of force curves that are known."""

import numpy as np
import pytest

from ruptfx.results.analysis.force_drops import Drop, averaged, drops, knees

# Ramps of 10 N/m per second that go on with 4 from a knee on, and two drops, of 3 and 5 N/m.
CORNERS = np.array([[0, 0], [0.6, 6], [1.1, 8], [1.2, 5], [1.6, 9], [2.1, 11], [2.3, 6], [3.0, 13]])
TIME = np.linspace(0, 3, 3001)
FORCE = np.interp(TIME, *CORNERS.T)


def test_planted_drops_and_knees():
    # Ringing of 0.3 N/m and a period of 10 ms vanishes in means over 20 ms.
    force = averaged(TIME, FORCE + 0.3 * np.sin(2 * np.pi * TIME / 0.01), 0.02)
    found = drops(TIME, force, 1.0)
    assert len(found) == 2
    # Means over 20 ms take 1/2 * 10 ms * (4 + 30) N/m/s * 1/4 from the first peak, as much again from the trough.
    for drop, wanted in zip(found, [Drop(1.1, 1.2, 3.0, 1.1), Drop(2.1, 2.3, 5.0, 0.9)], strict=True):
        assert [drop.start, drop.end, drop.ramp] == pytest.approx([wanted.start, wanted.end, wanted.ramp], abs=0.015)
        assert drop.size == pytest.approx(wanted.size, abs=0.3)
    bends = knees(TIME, force, found, 0.3)
    assert [bend.time for bend in bends] == pytest.approx([0.6, 1.6], abs=0.02)
    assert [(bend.before, bend.after) for bend in bends] == [pytest.approx((10, 4), rel=0.1)] * 2


def test_mean_of_uneven_records():
    """Of a parabola over a window w the mean is t^2 + w^2 / 12; records are linear in between, 1e-3 apart at most."""
    time = np.sort(np.random.default_rng(1).uniform(0, 1, 4000))
    mean = averaged(time, time**2, 0.2)
    inside = (time > 0.101) & (time < 0.899)
    np.testing.assert_allclose(mean[inside], time[inside] ** 2 + 0.04 / 12, atol=1e-5)


@pytest.mark.parametrize(
    "least, rise, sizes",
    [(0.4, 0.4, [2, 1.3, 3]), (0.4, 0.6, [2, 3.8]), (0.4, 2.0, [4]), (1.9, None, [2, 1.3, 3]), (2.5, 0.6, [3.8]),
     (5.0, None, [])],
)  # fmt: skip
def test_threshold(least, rise, sizes):
    """Falls of 2, 1.3 and 3 with rises of 1.8 and 0.5 between them; from 5 to 1 if no rise is counted."""
    force = np.array([0, 5, 3, 4.8, 3.5, 4, 1.0])
    expected = [size for size in sizes if size > least]
    assert [drop.size for drop in drops(np.arange(7.0), force, least, rise)] == pytest.approx(expected)


def test_a_slow_decline_is_no_part_of_a_drop():
    """A fall of 3 in 0.1 s, up by 0.5, and then 2 less in 10 s, in steps of 0.3 and back by 0.25."""
    slow = 2.5 - 0.05 * np.arange(41) + np.where(np.arange(41) % 2, 0.15, -0.15)
    time = np.concatenate([[0, 1, 1.1], np.linspace(1.3, 11.3, 41)])
    (found,) = drops(time, np.concatenate([[0, 5, 2], slow]), 1.0)
    assert (found.start, found.end, found.size) == (1.0, 1.1, 3.0)


def test_a_force_that_rises_has_none():
    assert drops(TIME, TIME, 0.1) == [] and knees(TIME, TIME, [], 1e-6) == []
    with_knee = knees(TIME, np.minimum(TIME, 1.0), [], 0.01)
    assert [(bend.time, bend.before, bend.after) for bend in with_knee] == [pytest.approx((1.0, 1.0, 0.0))]
