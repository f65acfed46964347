"""Near-tip fields against the printed fields at rest, the equations of motion and the energy that flows to the tip."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.laws.fracture import A_II, stress_intensity
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.results.analysis import near_tip
from ruptfx.results.analysis.near_tip import Medium, mode_II, mode_II_supershear, mode_III

PMMA = IsotropicElastic(young_modulus=5.65e9, poisson_ratio=0.33, density=1180.0)
MEDIUM = Medium.of(PMMA, "strain")
ANGLE = np.linspace(-0.999 * np.pi, 0.999 * np.pi, 41)
X, Y = 3e-3 * np.cos(ANGLE), 3e-3 * np.sin(ANGLE)


def test_medium() -> None:
    assert MEDIUM.modulus == pytest.approx(5.65e9 / (1 - 0.33**2), rel=1e-12)
    assert MEDIUM.density == pytest.approx(1180.0, rel=1e-12)
    assert Medium.of(PMMA, "stress").modulus == pytest.approx(5.65e9, rel=1e-12)


def williams(K: float, angle: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, ...]:
    """Stresses of mode II at rest (Williams 1957)."""
    sin, cos, sin3, cos3 = (f(n * angle / 2) for n in (1, 3) for f in (np.sin, np.cos))
    scale = K / np.sqrt(2 * np.pi * radius)
    return -scale * sin * (2 + cos * cos3), scale * sin * cos * cos3, scale * cos * (1 - sin * sin3)


@pytest.mark.parametrize("fraction", [0.0, 1e-9, 1e-4])
def test_slow_is_williams(fraction: float) -> None:
    found = mode_II(X, Y, fraction * MEDIUM.c_s, MEDIUM, 1e5).stress(MEDIUM)
    for stress, expected in zip(found, williams(1e5, ANGLE, np.full_like(ANGLE, 3e-3)), strict=True):
        np.testing.assert_allclose(stress, expected, rtol=0, atol=1e-6 * 1e5 / np.sqrt(2 * np.pi * 3e-3))


def derivative(values: object, name: str, axis: str) -> np.ndarray:
    """Central difference of a field at x + i y."""
    h, dx, dy = 1e-7, float(axis == "x"), float(axis == "y")
    return (values(X + h * dx, Y + h * dy)[name] - values(X - h * dx, Y - h * dy)[name]) / (2 * h)


@pytest.mark.parametrize("kind, fraction, power", [
    ("sub", 0.1, -0.5), ("sub", 0.6, -0.5), ("sub", 0.9, 0.5), ("super", 1.2, 0), ("super", 1.7, 0),
])  # fmt: skip
def test_equations_of_motion(kind: str, fraction: float, power: float) -> None:
    speed = fraction * MEDIUM.c_s

    def fields(x: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
        if kind == "sub":
            field = mode_II(x, y, speed, MEDIUM, 1e5, power)
        else:
            field = mode_II_supershear(x, y, speed, MEDIUM, 1e5)
        stress = dict(zip(("sxx", "syy", "sxy"), field.stress(MEDIUM), strict=True))
        return {**stress, "vx": field.velocity_x, "vy": field.velocity_y, "exx": field.xx, "exy": field.xy}

    # rho dv/dt = div sigma with d/dt = -v d/dx; and dv_x/dx is the rate of e_xx, e_xy that of its own.
    scale = np.abs(derivative(fields, "sxy", "x")).max()
    for along, (first, second) in {"vx": ("sxx", "sxy"), "vy": ("sxy", "syy")}.items():
        inertia = -MEDIUM.density * speed * derivative(fields, along, "x")
        divergence = derivative(fields, first, "x") + derivative(fields, second, "y")
        np.testing.assert_allclose(inertia, divergence, atol=1e-5 * scale)
    strain = np.abs(derivative(fields, "exx", "x")).max() * speed
    rate = -speed * derivative(fields, "exx", "x")
    np.testing.assert_allclose(derivative(fields, "vx", "x"), rate, atol=1e-5 * strain)
    turn = derivative(fields, "vx", "y") + derivative(fields, "vy", "x")
    np.testing.assert_allclose(turn, -2 * speed * derivative(fields, "exy", "x"), atol=1e-5 * strain)


@pytest.mark.parametrize("fraction", [0.05, 0.6, 0.9])
@pytest.mark.parametrize("zone", [0.0, 2e-3])
def test_changing_stress_intensity(fraction: float, zone: float) -> None:
    """Equations of motion in time and space, free faces, and K_II = rate x time at the tip."""
    speed = fraction * MEDIUM.c_s
    now = 3e-3 / speed
    rate = 1e5 / now

    def fields(x: np.ndarray, y: np.ndarray, time: float) -> dict[str, np.ndarray]:
        field = near_tip.mode_II_rate(x - speed * (time - now), y, np.full_like(x, time), speed, MEDIUM, rate, zone)
        stress = dict(zip(("sxx", "syy", "sxy"), field.stress(MEDIUM), strict=True))
        return {**stress, "vx": field.velocity_x, "vy": field.velocity_y, "exx": field.xx, "exy": field.xy}

    def slope(name: str, axis: str) -> np.ndarray:
        h = 1e-7
        if axis == "t":
            t = h / speed
            return (fields(X, Y, now + t)[name] - fields(X, Y, now - t)[name]) / (2 * t)
        return derivative(lambda x, y: fields(x, y, now), name, axis)

    scale = np.abs(slope("sxy", "x")).max()
    for along, (first, second) in {"vx": ("sxx", "sxy"), "vy": ("sxy", "syy")}.items():
        inertia = MEDIUM.density * slope(along, "t")
        np.testing.assert_allclose(inertia, slope(first, "x") + slope(second, "y"), atol=1e-5 * scale)
    strain = np.abs(slope("exx", "t")).max()
    np.testing.assert_allclose(slope("vx", "x"), slope("exx", "t"), atol=1e-5 * strain)
    np.testing.assert_allclose(slope("vx", "y") + slope("vy", "x"), 2 * slope("exy", "t"), atol=1e-5 * strain)

    x, zero, times = np.array([1e-3, 4e-3]), np.zeros(2), np.full(2, now)
    _, normal, shear = near_tip.mode_II_rate(-x - zone, zero, times, speed, MEDIUM, rate, zone).stress(MEDIUM)
    np.testing.assert_allclose(np.abs(normal) + np.abs(shear), 0, atol=1e-9 * 1e5 / np.sqrt(x[0]))
    tip = np.array([1e-9])
    near = near_tip.mode_II_rate(tip, zero[:1], times[:1], speed, MEDIUM, rate).stress(MEDIUM)[2]
    assert near[0] * np.sqrt(2 * np.pi * tip[0]) == pytest.approx(1e5, rel=1e-4)


@pytest.mark.parametrize("fraction", [0.3, 0.9, 1.2, 1.7])
def test_faces_and_line_ahead(fraction: float) -> None:
    speed = fraction * MEDIUM.c_s
    x, zero = np.array([1e-3, 4e-3]), np.zeros(2)
    field = mode_II if fraction < 1 else mode_II_supershear
    _, normal, shear = field(-x, zero, speed, MEDIUM, 1e5).stress(MEDIUM)
    scale = field(x, zero, speed, MEDIUM, 1e5).stress(MEDIUM)[2]
    # Free faces; ahead only the shear stress given.
    np.testing.assert_allclose(np.abs(normal) + np.abs(shear), 0, atol=1e-9 * scale.max())
    q = 0.5 if fraction < 1 else near_tip.supershear_exponent(speed, MEDIUM)
    expected = 1e5 * x**-q / (np.sqrt(2 * np.pi) if fraction < 1 else 1)
    np.testing.assert_allclose(scale, expected, rtol=1e-9)
    np.testing.assert_allclose(field(x, zero, speed, MEDIUM).stress(MEDIUM)[1], 0, atol=1e-9 * scale.max())


def test_mode_iii() -> None:
    speed, K, h = 0.6 * MEDIUM.c_s, 1e5, 4e-3
    a_s = 0.8  # sqrt(1 - 0.36)
    x = np.linspace(-10e-3, 10e-3, 200001)
    xz, _, velocity = mode_III(x, np.full_like(x, h), speed, MEDIUM, K)
    # Im z^-1/2 = -sin(theta/2) / sqrt(r), r = a_s h / sin(theta): largest at theta = 120 degrees, where
    # sin(theta/2) sqrt(sin(theta)) = (3/4)^(3/4).
    assert x[np.argmin(xz)] == pytest.approx(-a_s * h / np.sqrt(3), abs=2e-7)
    size = K / (2 * MEDIUM.shear_modulus * a_s) * 0.75**0.75 / np.sqrt(2 * np.pi * a_s * h)
    assert xz.min() == pytest.approx(-size, rel=1e-8)
    np.testing.assert_allclose(velocity, -2 * speed * xz)
    ahead = mode_III(np.array([h]), np.zeros(1), speed, MEDIUM, K)[1]
    assert 2 * MEDIUM.shear_modulus * ahead[0] == pytest.approx(K / np.sqrt(2 * np.pi * h))


def test_supershear_limits() -> None:
    # tan(pi q) is infinite where b = 1, at sqrt(2) c_s; there sin(Mach angle) = 1 / sqrt(2), and nothing jumps at it.
    speed = np.sqrt(2) * MEDIUM.c_s
    assert near_tip.supershear_exponent(speed, MEDIUM) == pytest.approx(0.5, abs=1e-9)
    assert near_tip.mach_angle(speed, MEDIUM) == pytest.approx(np.pi / 4, rel=1e-9)

    def jump(fraction: float) -> float:
        speed = fraction * MEDIUM.c_s
        b, h = np.sqrt(fraction**2 - 1), 4e-3
        x = np.array([-b * h - 1e-6, -b * h + 1e-6])
        velocity = mode_II_supershear(x, np.full(2, h), speed, MEDIUM).velocity_y
        return float(abs(np.diff(velocity)[0] / velocity[1]))

    assert jump(1.6) > 1
    assert jump(np.sqrt(2)) < 1e-3
    # Weaker than 1/2 everywhere else, gone at c_s and c_p.
    exponents = [near_tip.supershear_exponent(f * MEDIUM.c_s, MEDIUM) for f in (1.001, 1.2, 1.7, 1.98)]
    assert all(0 < q < 0.5 for q in exponents) and exponents[0] < 0.1 and exponents[-1] < 0.2


def test_strain_extremes_at_rest() -> None:
    """PMMA, 2.5 J/m2, 4 mm above the interface: K = sqrt(Gamma E') = 0.1259 MPa sqrt(m)."""
    K = stress_intensity(2.5, MEDIUM.modulus)
    assert K == pytest.approx(0.1259e6, rel=1e-3)  # noqa: SIM300
    angle = np.linspace(1e-4, np.pi - 1e-4, 20001)
    xx, yy, xy = williams(K, angle, 4e-3 / np.sin(angle))
    nu, shear = 0.33, PMMA.shear_modulus
    expected = {"xx": ((1 - nu) * xx - nu * yy) / (2 * shear), "yy": ((1 - nu) * yy - nu * xx) / (2 * shear),
                "xy": xy / (2 * shear)}  # fmt: skip
    found = near_tip.strain_extremes(4e-3, K, 0.0, MEDIUM)
    for name, values in expected.items():
        assert found[f"{name}_max"] == pytest.approx(values.max(), rel=1e-5, abs=1e-8)
        assert found[f"{name}_min"] == pytest.approx(values.min(), rel=1e-5, abs=1e-8)
    # A hundred to some hundred microstrain.
    assert 1e-4 < -found["xx_min"] < 3e-4


def test_energy() -> None:
    # K of the printed table at 0.5 c_R has 2.5 J/m2.
    assert A_II(0.5 * MEDIUM.c_R, MEDIUM.c_p, MEDIUM.c_s) * 0.1203e6**2 / MEDIUM.modulus == pytest.approx(2.5, rel=1e-3)


@pytest.mark.parametrize("call, text", [
    (lambda: mode_II(X, Y, 1300.0, MEDIUM), "0 <= speed < c_R = 1250"),
    (lambda: mode_III(X, Y, -1.0, MEDIUM), "0 <= speed < c_s"),
    (lambda: near_tip.mach_angle(1200.0, MEDIUM), "supershear is c_s < speed < c_p"),
])  # fmt: skip
def test_refuses(call: object, text: str) -> None:
    with pytest.raises(RuptfxError, match=facts(text)):
        call()
