"""Stress-optic law and polariscope."""

import numpy as np
import pytest

from ruptfx import RuptfxError
from ruptfx.results.analysis import photoelasticity as photo


def test_principal_difference():
    # Uniaxial 3: 3. Pure shear 2: 4. Hydrostatic: 0.
    np.testing.assert_allclose(photo.principal_difference(*np.array([[3, 0, 5.0], [0, 0, 5], [0, 2, 0]])), [3, 4, 0])


def test_principal_direction():
    # Tension along x: 0. Along y: 90 degrees. Shear xy: 45 degrees.
    found = photo.principal_direction(np.array([3.0, 0, 0]), np.array([0.0, 3, 0]), np.array([0, 0, 1.0]))
    np.testing.assert_allclose(np.abs(found), [0, np.pi / 2, np.pi / 4])


def test_isoclinics_are_black_at_any_order():
    # Between them, 45 degrees away, the light is that of a circular polariscope.
    order, zero = np.linspace(0, 3, 50), np.zeros(50)
    np.testing.assert_allclose(photo.plane_intensity(order, zero + np.pi / 2, 0.0), 0, atol=1e-30)
    np.testing.assert_allclose(photo.plane_intensity(order, zero + 0.3, 0.3 - np.pi / 4), photo.intensity(order))


def test_fringe_order():
    # 20 kN/m over 6 mm is 3.33 MPa per fringe.
    assert photo.fringe_order(np.array(10e6), fringe_constant=20e3, thickness=6e-3) == pytest.approx(3)


def test_fields_are_complements():
    order = np.linspace(0, 3, 50)
    dark, light = photo.intensity(order), photo.intensity(order, "light")
    np.testing.assert_allclose(dark + light, 1)
    # Whole orders are black in the dark field.
    np.testing.assert_allclose(photo.intensity(np.arange(4.0)), 0, atol=1e-30)


def test_unknown_field():
    with pytest.raises(RuptfxError, match="'grey'"):
        photo.intensity(np.zeros(1), "grey")
