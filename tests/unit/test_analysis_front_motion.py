"""Equation of motion against closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.laws import fracture
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.results.analysis.front_motion import front_motion, static_stress_intensity
from ruptfx.results.analysis.near_tip import Medium

MEDIUM = Medium.of(IsotropicElastic(young_modulus=5.65e9, poisson_ratio=0.33, density=1180.0), "strain")
DROP, GAMMA = 0.4e6, 2.5
CRITICAL = fracture.critical_half_length(GAMMA, MEDIUM.modulus, DROP)


def uniform(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.full_like(x, value)


def test_static_stress_intensity() -> None:
    assert static_stress_intensity(0.02, uniform(DROP), "bilateral") == pytest.approx(DROP * np.sqrt(np.pi * 0.02))
    # 1.1215 sqrt(pi a) from an edge; the weight function is good to 1 %.
    assert static_stress_intensity(0.02, uniform(DROP), "edge") == pytest.approx(
        1.1215 * DROP * np.sqrt(np.pi * 0.02), rel=0.01
    )
    # One tip, uniform drop: sqrt(2 / pi) drop 2 sqrt(l); beyond b less by the same of l - b.
    one = static_stress_intensity(0.02, lambda x: np.where(x < 0.015, DROP, 0.0), "one tip")
    assert one == pytest.approx(np.sqrt(8 / np.pi) * DROP * (np.sqrt(0.02) - np.sqrt(0.005)), rel=1e-3)
    # Of the inner half only: 2 sqrt(l / pi) arcsin(1/2) = sqrt(pi l) / 3.
    inner = static_stress_intensity(0.02, lambda x: np.where(x < 0.01, DROP, 0.0), "bilateral")
    assert inner == pytest.approx(DROP * np.sqrt(np.pi * 0.02) / 3, rel=5e-3)
    # Long crack in a strip: G = drop^2 H / G = K^2 / (2 G*), K = drop sqrt(2 H*).
    assert static_stress_intensity(5.0, uniform(DROP), "bilateral", 0.03) == pytest.approx(DROP * np.sqrt(0.06))


def test_uniform_drop() -> None:
    lengths = np.linspace(1.01, 10, 50) * CRITICAL
    found = front_motion(lengths, uniform(DROP), uniform(GAMMA), MEDIUM)
    np.testing.assert_allclose(found.energy_ratio, lengths / CRITICAL)
    for length, speed in zip(found.length[::7], found.speed[::7], strict=True):
        g = fracture.g_II(float(speed), MEDIUM.c_p, MEDIUM.c_s, MEDIUM.c_R)
        assert g == pytest.approx(CRITICAL / length, rel=2e-3)
    assert np.isnan(found.arrest) and np.all(np.diff(found.speed) > 0)
    np.testing.assert_allclose(np.gradient(found.length, found.time)[5:-1], found.speed[5:-1], rtol=0.05)


def test_arrest() -> None:
    # Drop 1 up to b, none beyond: K = 2 drop sqrt(l / pi) arcsin(b / l), K^2 / E' = Gamma with CRITICAL = 1 is
    # (4 / pi^2) l arcsin(b / l)^2 = 1; at b = 4, l = 7.25: 7.25 x 0.4053 x 0.5844^2 = 1.0035; at 7.28: 7.28 x 0.4053
    # x 0.5817^2 = 0.9985; linear between them 7.271.
    found = front_motion(
        np.linspace(1.1, 12, 800) * CRITICAL, lambda x: np.where(x < 4 * CRITICAL, DROP, 0.0), uniform(GAMMA), MEDIUM
    )
    assert found.arrest / CRITICAL == pytest.approx(7.271, abs=0.01)
    assert np.all(found.speed[found.length > found.arrest] == 0) and np.isinf(found.time[-1])
    # Twice the contact area in the barrier stops it there at once: Gamma doubles at 2, where G_s is 2 Gamma.

    def area(x: np.ndarray) -> np.ndarray:
        return np.where(x < 1.9 * CRITICAL, GAMMA, 2 * GAMMA)

    stopped = front_motion(np.linspace(1.1, 4, 800) * CRITICAL, uniform(DROP), area, MEDIUM)
    assert stopped.arrest / CRITICAL == pytest.approx(1.9, abs=0.01)


@pytest.mark.parametrize("arguments, text", [
    ((np.array([0.5, 0.9]) * CRITICAL, uniform(DROP), uniform(GAMMA), MEDIUM), "does not begin; begin with a longer"),
    ((np.array([2.0, 1.0]), uniform(DROP), uniform(GAMMA), MEDIUM), "must be positive, increase"),
    ((np.array([1.0, 2.0]), uniform(DROP), uniform(GAMMA), MEDIUM, "round"), "shape = 'round'"),
])  # fmt: skip
def test_refuses(arguments: tuple, text: str) -> None:
    with pytest.raises(RuptfxError, match=facts(text)):
        front_motion(*arguments)
