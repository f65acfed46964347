"""Runge-Kutta steps: conditions on the coefficients, and errors of a solution that is known."""

from __future__ import annotations

import numpy as np
import pytest

from ruptfx.stepping.steppers._runge_kutta import ERROR, NODES, WEIGHTS, attempt


def test_coefficients_fulfil_the_conditions_of_their_order() -> None:
    """Each stage is at the sum of its weights; sum_i b_i c_i^k = 1 / (k + 1), and sum_ij b_i a_ij c_j = 1/6."""
    c, b = np.array(NODES, float), np.append(WEIGHTS[-1], 0.0)
    assert [row.sum() for row in WEIGHTS] == pytest.approx(list(NODES), abs=1e-14)
    assert [b @ c**k for k in range(5)] == pytest.approx([1, 1 / 2, 1 / 3, 1 / 4, 1 / 5], abs=1e-14)
    assert [(b + ERROR) @ c**k for k in range(4)] == pytest.approx([1, 1 / 2, 1 / 3, 1 / 4], abs=1e-14)
    assert abs((b + ERROR) @ c**4 - 1 / 5) > 1e-5  # of order four only
    inner = np.array([row @ c[: len(row)] for row in WEIGHTS])
    assert b @ inner == pytest.approx(1 / 6, abs=1e-14)


def test_errors_decrease_with_the_order() -> None:
    """dy/dt = y: a step of half the length has an error smaller by 2^6, and an estimate smaller by 2^5."""
    start = np.ones((1, 1))
    ends, wrong, last = zip(*(attempt(lambda part, y: (y, part), start, dt) for dt in (0.2, 0.1)), strict=True)
    errors = [abs(float(end[0, 0]) - np.exp(dt)) for end, dt in zip(ends, (0.2, 0.1), strict=True)]
    assert last == (1, 1) and errors[0] / errors[1] == pytest.approx(64, rel=0.1)
    assert float(wrong[0][0, 0] / wrong[1][0, 0]) == pytest.approx(32, rel=0.1)
