"""Crack formulas against printed values."""

from __future__ import annotations

import numpy as np
import pytest

from ruptfx.laws import fracture
from ruptfx.laws.materials import Plane
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

# PMMA, plane strain (Svetlizky, Bayart, Fineberg 2019, review): values at these fractions of c_R.
PMMA = IsotropicElastic(young_modulus=5.65e9, poisson_ratio=0.33, density=1180.0)
C_P, C_S, C_R = PMMA.wave_speeds("strain")
MODULUS = 5.65e9 / (1 - 0.33**2)
SPEEDS = np.array([0.1, 0.3, 0.5, 0.7, 0.9]) * C_R


def test_speeds_and_modulus() -> None:
    assert tuple(PMMA.wave_speeds("strain")) == pytest.approx((2663.5, 1341.7, 1250.5), abs=0.06)
    assert 2 * fracture.effective_modulus(PMMA.shear_modulus, C_P, C_S) == pytest.approx(MODULUS, rel=1e-12)
    assert fracture.rayleigh_function(C_R, C_P, C_S) == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("speed, A, K, g", list(zip(
    SPEEDS, [1.0031, 1.0299, 1.0957, 1.2522, 1.9507], [0.1257, 0.1241, 0.1203, 0.1125, 0.0901],
    [0.9321, 0.8053, 0.6815, 0.5429, 0.3201], strict=True,
)))  # fmt: skip
def test_near_tip_functions(speed: float, A: float, K: float, g: float) -> None:
    found = fracture.A_II(speed, C_P, C_S)
    assert found == pytest.approx(A, abs=6e-5)
    # Fracture energy 2.5 J/m2.
    assert fracture.stress_intensity(2.5, MODULUS, found) / 1e6 == pytest.approx(K, abs=6e-5)
    assert fracture.g_II(speed, C_P, C_S, C_R) == pytest.approx(g, abs=6e-5)


def test_slow_fronts() -> None:
    # D c_s^2 / v^2 is 16 (1 - k) / 8 at rest, k = c_s^2 / c_p^2: A_II = 1 there. Next, with x = v^2 / c_s^2, the
    # numerator is 16 (1 - k) - (24 - 16 k) x, the sum of the two terms 8 - (6 + 2 k) x and a_s = 1 - x / 2, so that
    # A_II = 1 + x [(24 - 16 k) / (16 (1 - k)) - (6 + 2 k) / 8 - 1/2] = 1 + x (1 + k^2) / (4 (1 - k)).
    k = (C_S / C_P) ** 2
    slope = (1 + k**2) / (4 * (1 - k))
    speeds = np.geomspace(1e-12, 1e-2, 41)
    found = np.array([fracture.A_II(fraction * C_S, C_P, C_S) for fraction in speeds])
    np.testing.assert_allclose(found, 1 + slope * speeds**2, rtol=1e-7)
    np.testing.assert_allclose(found[speeds < 1e-5], 1, rtol=1e-9)
    assert fracture.A_II(0.0, C_P, C_S) == pytest.approx(1, rel=1e-14)
    # Where nothing cancels it is the printed formula.
    for speed in (*SPEEDS, C_R):
        a_p, a_s = fracture.slowness_factors(speed, C_P, C_S)
        printed = 4 * a_s * a_p - (1 + a_s**2) ** 2
        assert fracture.rayleigh_function(speed, C_P, C_S) == pytest.approx(printed, rel=1e-9, abs=1e-14)
    assert fracture.half_length_at(1e-8 * C_S, C_P, C_S) == pytest.approx(1, rel=1e-6)
    assert fracture.g_II(1e-8 * C_S, C_P, C_S, C_R) == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("fraction, length", [(0.5, 1.377), (0.7, 1.795), (0.9, 3.20)])
def test_bilateral_crack(fraction: float, length: float) -> None:
    assert fracture.half_length_at(fraction * C_R, C_P, C_S) == pytest.approx(length, rel=1e-3)
    assert fracture.speed_at(length, C_P, C_S, C_R) == pytest.approx(fraction * C_R, rel=1e-3)


def test_self_similar_factors() -> None:
    # nu = 0.25: c_p = sqrt(3) c_s.
    found = [fracture.self_similar_factor_II(v, np.sqrt(3), 1.0) for v in (0.1, 0.3, 0.5, 0.7, 0.9)]
    assert found == pytest.approx([1.34978, 1.42976, 1.54118, 1.67069, 1.81224], abs=6e-6)
    # At rest a mode III crack has slip 2 T / G sqrt(a^2 - x^2).
    assert fracture.self_similar_factor_III(1e-9, 1.0) == pytest.approx(1.0, abs=1e-12)


def test_static_process_zone() -> None:
    # Rock of the slip-weakening demo: G = 80.1 / 2.5 = 32.04, G* = G / 0.75 = 42.72 GPa, D_c = 0.4 m, drop 18.24 MPa:
    # 9 pi / 32 x 42.72e9 x 0.4 / 18.24e6 = 827.8 m.
    rock = IsotropicElastic(young_modulus=80.1e9, poisson_ratio=0.25, density=2670.0)
    c_p, c_s, _ = rock.wave_speeds("strain")
    modulus = fracture.effective_modulus(rock.shear_modulus, c_p, c_s)
    assert fracture.static_process_zone(modulus, 0.4, 18.24e6) == pytest.approx(827.8, abs=0.1)


# Burridge's limit at Poisson's ratios; in plane stress 0.25 acts as 0.25 / 1.25 = 0.20.
@pytest.mark.parametrize(
    "plane, ratio, limit",
    [("strain", 0.20, 1.592), ("strain", 0.25, 1.775), ("strain", 0.30, 1.977), ("strain", 0.35, 2.199),
     ("stress", 0.25, 1.592)],
)  # fmt: skip
def test_supershear_limit(plane: Plane, ratio: float, limit: float) -> None:
    speeds = IsotropicElastic(young_modulus=80e9, poisson_ratio=ratio, density=2700.0).wave_speeds(plane)
    assert fracture.supershear_limit(*speeds) == pytest.approx(limit, abs=6e-4)


def test_generalized_rayleigh_speed() -> None:
    top = IsotropicElastic(young_modulus=5.3e9, poisson_ratio=0.25, density=1246.0)
    bottom = IsotropicElastic(young_modulus=3.392e9, poisson_ratio=0.25, density=1246.0)
    for plane, expected in (("strain", 1036.2), ("stress", 1031.3)):
        speeds = [m.wave_speeds(plane) for m in (top, bottom)]
        found = fracture.generalized_rayleigh_speed(speeds, [top.shear_modulus, bottom.shear_modulus])
        assert found == pytest.approx(expected, abs=0.1)
    same = fracture.generalized_rayleigh_speed([speeds[0]] * 2, [top.shear_modulus] * 2)
    assert same == pytest.approx(speeds[0].c_R, rel=1e-12)
    steel = IsotropicElastic(young_modulus=200e9, poisson_ratio=0.3, density=7800.0)
    strange = [m.wave_speeds("strain") for m in (top, steel)]
    assert fracture.generalized_rayleigh_speed(strange, [top.shear_modulus, steel.shear_modulus]) is None
