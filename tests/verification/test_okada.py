"""Slip on a dipping rectangle below the surface of a half-space: Okada's table, and the finite elements."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from benchmarks import prescribed_slip
from benchmarks._okada import surface_displacement

pytestmark = pytest.mark.fem


@pytest.mark.parametrize("slip, expected", [
    ((1.0, 0.0), (-8.689e-3, -4.298e-3, -2.747e-3)), ((0.0, 1.0), (-4.682e-3, -3.527e-2, -3.564e-2)),
])  # fmt: skip
def test_reference_is_that_of_the_published_table(slip: tuple[float, float], expected: tuple[float, ...]) -> None:
    """Case 2 of the check list: x = 2, y = 3, depth 4, dip 70 degrees, 3 x 2, Poisson's ratio 0.25."""
    at, slips = (np.array([value]) for value in (2.0, 3.0)), tuple(np.array([value]) for value in slip)
    corner = np.zeros(1), np.zeros(1), np.array([4.0])
    u = surface_displacement(*at, corner, (3.0, 2.0), np.deg2rad(70.0), (slips[0], slips[1]), 0.25)
    np.testing.assert_allclose(u[0], expected, rtol=0, atol=6e-6)


def test_surface_above_a_dipping_fault() -> None:
    """Elements of 4 km in a box of 40 km: 4 % of the peak, mainly by the elements (2 km: 1.9 %, by the box)."""
    _, ours, theirs = prescribed_slip.dipping(4e3, 40e3)
    peak = np.abs(theirs).max()
    assert peak == pytest.approx(0.0666, rel=2e-2)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=0.04 * peak)
