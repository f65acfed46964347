"""The closed form of `ruptfx bench waves_3d` against numbers of an independent computation, and a coarse explosion."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from benchmarks import waves_3d as bench

pytestmark = pytest.mark.fem

# Displacement at (3, 2, 1) km by time, from fourth-order differences of the solution of a point force (Stokes), which
# agree to 2e-12 m; the last is static, as differences of Kelvin's solution give it.
DOUBLE_COUPLE = {
    0.6: (0.0, 0.0, 0.0),
    0.7: (3.387694e-05, 2.093135e-05, 1.195362e-05),
    1.1: (1.794982e-03, 7.829841e-04, 7.637954e-04),
    1.3: (2.874388e-03, 1.734850e-03, 1.030693e-03),
    1.8: (1.621974e-03, 2.091965e-03, 1.363984e-04),
    2.2: (1.518250e-03, 1.272650e-03, 4.018897e-04),
}


def test_the_closed_form_of_a_double_couple() -> None:
    tensor = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 0]])
    found = bench.full_space(tensor, np.array(list(DOUBLE_COUPLE)))
    np.testing.assert_allclose(found, list(DOUBLE_COUPLE.values()), atol=2e-9)


def test_the_closed_form_of_an_explosion_is_radial() -> None:
    """Moment, its rate and P waves only: [M(t - r / c_p) / r^2 + M'(t - r / c_p) / (c_p r)] / (4 pi rho c_p^2)."""
    time, x = np.linspace(0.5, 2.5, 21), np.array(bench.RECEIVER)
    r = float(np.linalg.norm(x))
    amount, rate = bench.course(time - r / bench.C_P)
    wanted = bench.MOMENT * (amount / r**2 + rate / (bench.C_P * r)) / (4 * np.pi * bench.RHO * bench.C_P**2)
    np.testing.assert_allclose(bench.full_space(np.eye(3), time), np.outer(wanted, x / r), atol=1e-9)


@pytest.mark.parametrize("kind", ["explosion", "double couple"])
def test_a_source_in_a_corner_of_the_full_space(kind: str) -> None:
    """Elements of 1 km, 7 nodes per S wave of 2 Hz: 0.4 and 0.6 % of the peak."""
    _, found, exact, closure = bench.source(kind, 1000.0, 9e3)
    off = np.abs(found - exact).max(axis=1) / np.abs(exact).max()
    assert off.max() < 0.01 and np.abs(exact).max() > 1e-4 and closure < 1e-9
