"""Theory of rough contact against numbers that are known."""

import numpy as np
import pytest

from ruptfx.laws.rough_contact import full_contact_pressure, rough, waves

# Plane strain, 5.3 and 3.392 GPa, nu 0.25: E* = 1 / (0.9375 / 5.3e9 + 0.9375 / 3.392e9).
MODULUS = 1 / (0.9375 / 5.3e9 + 0.9375 / 3.392e9)


def test_two_opposed_waves():
    """Amplitude 20 um over 0.6 mm: p* = 231.0 MPa; 13.3 % touch at 10 MPa, 9.4 % at 5 MPa."""
    full = full_contact_pressure(MODULUS, 20e-6, 0.6e-3)
    assert full == pytest.approx(231.0e6, rel=1e-3)
    assert waves(10e6, full).fraction == pytest.approx(0.133, abs=5e-4)
    assert waves(5e6, full).fraction == pytest.approx(0.094, abs=5e-4)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_the_pressure_of_waves_adds_up(share):
    """Its mean over a wavelength, p(x) = peak cos(psi) sqrt(1 - (sin(psi) / sin(psi_a))^2), is what presses."""
    touch = waves(share, 1.0)
    psi = np.linspace(-1, 1, 20001) * 0.5 * np.pi * touch.fraction
    local = touch.pressure * np.cos(psi) * np.sqrt(1 - np.clip(np.sin(psi) / np.sin(psi[-1]), -1, 1) ** 2)
    assert np.trapezoid(local, psi) / np.pi == pytest.approx(share, rel=1e-5)


def test_full_contact():
    assert waves(1.5, 1.0) == (1.0, 2.5)
    np.testing.assert_allclose(waves(1 - 1e-12, 1.0), (1.0, 2.0), rtol=1e-5)
    assert rough(10.0, 1.0, 1.0) == pytest.approx((1.0, 10.0))


def test_light_contact_of_rough_surfaces():
    """erf(x) = 2 x / sqrt(pi) for small x: the fraction is sqrt(8 / pi) p / (E* slope)."""
    touch = rough(1e-4, 2.0, 0.1)
    assert touch.fraction == pytest.approx(np.sqrt(8 / np.pi) * 1e-4 / 0.2, rel=1e-5)
    assert touch.fraction * touch.pressure == pytest.approx(1e-4)
