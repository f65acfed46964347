"""The formulas of a contact point, by hand and by differences."""

from __future__ import annotations

import numpy as np
import pytest

from ruptfx.interfaces.faults import point_step


def shifted(shear: list[float], before: list[float], weight: float, z: float = 2.0) -> point_step.ShiftedTrial:
    return point_step.shifted_trial(
        [np.array(t) for t in shear], [np.array(z)] * len(shear), [np.array(v) for v in before], weight
    )


def test_a_slip_rate_along_the_trial_is_carried() -> None:
    # trial' = 10 + 1 * 2 * 3 = 16 Pa; it is relieved at 16 / 2 = 8 m/s, of which 3 m/s are the shift.
    trial = shifted([10.0], [3.0], 1.0)
    assert (trial.shear[0], trial.size, trial.direction[0], trial.shift_along) == (16.0, 16.0, 1.0, 3.0)
    assert (trial.free_velocity[0], trial.free_rate, trial.rate_before) == (8.0, 5.0, 3.0)
    # Both components of (3, 4) with V_before = (3, 4): trial' = 3 (3, 4), of length 15, V_before of length 5.
    trial = shifted([3.0, 4.0], [3.0, 4.0], 1.0)
    assert (trial.size, trial.shift_along, trial.rate_before, trial.free_rate) == (15.0, 5.0, 5.0, 2.5)
    np.testing.assert_allclose(trial.direction, [0.6, 0.8], rtol=1e-15)
    assert trial.mean_impedance == pytest.approx(2.0, rel=1e-15)


def test_a_point_stops_before_it_reverses() -> None:
    for weight in (1.0, -0.25):
        trial = shifted([10.0], [-3.0], weight)
        assert (trial.shear[0], trial.shift[0], trial.rate_before, trial.free_rate) == (10.0, 0.0, 0.0, 5.0)


@pytest.mark.parametrize("weight, shift", [(-0.4, -0.8), (-0.6, 0.0)])
def test_a_shift_backwards_is_at_most_half_of_the_trial(weight: float, shift: float) -> None:
    """|k Z V_before| is 0.4 * 2 * 2 = 1.6 or 0.6 * 2 * 2 = 2.4 Pa of a trial of 4 Pa."""
    assert shifted([4.0], [2.0], weight).shift[0] == shift
    assert shifted([2.4, 3.2], [1.2, 1.6], weight).shift[1] == pytest.approx(0.8 * shift, rel=1e-15)


def test_residuals_have_their_slope_and_direction() -> None:
    """With Z = (1, 3), strength 1 + 0.5 V, V = 2 and no shift the resistances are 2 + 2 = 4 and 2 + 6 = 8."""
    z, direction = (1.0, 3.0), np.array([0.6, 0.8])
    shear = [0.6 * 4.0, 0.8 * 8.0]
    trial = point_step.shifted_trial(shear, z, [0.0, 0.0], 1.0)
    at_root = point_step.balance(trial, 2.0, 2.0, 0.5)
    np.testing.assert_allclose(at_root.direction, direction, rtol=1e-15)
    assert abs(at_root.residual) < 1e-14
    h = 1e-6
    after, earlier = (point_step.balance(trial, 2 + d, 2 + 0.5 * d, 0.5).residual for d in (h, -h))
    assert (earlier - after) / (2 * h) == pytest.approx(at_root.slope, rel=1e-9)
    single = point_step.balance(shifted([10.0], [3.0], 1.0), 2.0, 1.5, 0.5)
    assert (single.residual, single.slope) == (16 - 2 * 5 - 1.5, 2.5)


@pytest.mark.parametrize("at_end", [True, False])
def test_slip_rates_of_open_stuck_and_sliding_points(at_end: bool) -> None:
    """Three points with trial' = 16 Pa, Z = 2 Pa s/m, V_before = 3 m/s: open, stuck, sliding with V = 1 m/s."""
    each = np.ones(3)
    trial = point_step.shifted_trial([10 * each], [2 * each], [3 * each], 1.0)
    result = point_step.sliding(
        trial, [10 * each], [3 * each], np.array([5.0, 0.0, 1.0]), np.array([4.0, 7.0, 2.0]), [each],
        is_open=np.array([True, False, False]), is_stuck=np.array([False, True, False]), at_end=at_end,
    )  # fmt: skip
    np.testing.assert_array_equal(result.mean_slip_rate[0], [8 - 3, 0, 1 + 3 - 3])
    np.testing.assert_array_equal(result.shear_traction[0], [0, 10, 10 - 2])
    np.testing.assert_array_equal(result.slip_rate[0], [4, 0, 2] if at_end else [0.5 * 8, 0.5 * 3, 2])


def test_openings() -> None:
    # 3 Pa of tension beyond what is carried open a compliance of 0.5 m/Pa by 1.5 m.
    assert point_step.opening_after(0.0, -3.0, 0.5, 1.0, 2.0, at_end=True) == 1.5
    pressed, gap = np.array([1.0, 0.0, 0.0]), np.array([2.0, 2.0, -2.0])
    opening = point_step.opening_after(0.0, -3.0, 0.5, pressed, gap, at_end=False)
    np.testing.assert_array_equal(opening, [0, 2, 0])


def test_a_length_that_is_not_a_number_remains_one() -> None:
    np.testing.assert_array_equal(point_step.length([np.array([3.0, 0.0, np.nan]), np.array([4.0, 0.0, 1.0])]),
                                  [5.0, 0.0, np.nan])  # fmt: skip
