"""Nucleations against their published formulas, written out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ruptfx.nucleation.smooth_patch import SmoothPatch


def test_smooth_patch() -> None:
    """TPV101: F(r) = exp(r^2 / (r^2 - R^2)), G(t) = exp((t - T)^2 / (t (t - 2 T))); with R = 1, T = 4.

    At r = R / 2: 0.25 / (0.25 - 1) = -1/3. At t = T / 2: (T / 2)^2 / (T / 2 (-3 T / 2)) = -1/3.
    At t = T / 4: (3 T / 4)^2 / (T / 4 (-7 T / 4)) = -9/7.
    """
    patch = SmoothPatch(extra=2.0, center=0.5, radius=1.0, rise=4.0)
    there = np.array([0.5, 1.0, 0.0, 1.5, 2.0])
    third = np.exp(-1 / 3)
    np.testing.assert_allclose(patch.shear_traction(there, 4.0), [2.0, 2 * third, 2 * third, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(patch.shear_traction(there, 2.0), third * patch.shear_traction(there, 4.0), rtol=1e-12)
    assert patch.shear_traction(there, 1.0)[0] == pytest.approx(2 * np.exp(-9 / 7), rel=1e-12)
    assert not patch.shear_traction(there, 0.0).any()
    assert patch.shear_traction(there, 9.0)[0] == 2.0
