"""The fit of a front recovers what made the traces, and refuses what no front made."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from xarray import DataArray

from ruptfx import RuptfxError
from ruptfx.laws.fracture import A_II, stress_intensity
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.results.analysis import front_fit
from ruptfx.results.analysis.front_fit import FrontFit, Trace, fit_front
from ruptfx.results.analysis.near_tip import Medium, mode_II, mode_II_rate

MEDIUM = Medium.of(IsotropicElastic(young_modulus=5.65e9, poisson_ratio=0.33, density=1180.0), "strain")
GAMMA, PASSAGE = 2.5, 2e-5


def traces(
    fraction: float, noise: float = 0.0, direction: int = 1, zone: float = 0.0, ripple: float = 0.0
) -> list[Trace]:
    """Three gauges side by side 3.5 mm high, and a front of 2.5 J/m2 that passes the middle one at PASSAGE; with other
    fields that fronts have: 1 MPa along the interface, -0.5 MPa of shear, one that grows with sqrt(r), and that of K_II
    which grows by half over 80 mm. A ripple is what the front does not explain."""
    speed = fraction * MEDIUM.c_R
    K = stress_intensity(GAMMA, MEDIUM.modulus, A_II(speed, MEDIUM.c_p, MEDIUM.c_s))
    time = PASSAGE + np.linspace(-30e-3, 40e-3, 400) / speed
    random = np.random.default_rng(5)
    result = []
    for x in (-4e-3, 0.0, 4e-3):
        ahead = x - speed * (time - PASSAGE)
        singular = mode_II(ahead, np.full(400, 3.5e-3), speed, MEDIUM, K, zone=zone)
        growing = mode_II(ahead, np.full(400, 3.5e-3), speed, MEDIUM, 5 * K, 0.5, zone)
        changing = mode_II_rate(
            ahead, np.full(400, 3.5e-3), time - PASSAGE, speed, MEDIUM, 0.5 * K * speed / 80e-3, zone
        )
        strain = {
            "xx": singular.xx + growing.xx + changing.xx + 1e6 / MEDIUM.modulus,
            # Plane strain: e_yy = -nu / (1 - nu) e_xx of a stress along x.
            "yy": singular.yy + growing.yy + changing.yy - 0.33 / 0.67 * 1e6 / MEDIUM.modulus,
            "xy": direction * (singular.xy + growing.xy + changing.xy - 0.5e6 / (2 * MEDIUM.shear_modulus)),
        }
        largest = np.abs(singular.xx).max()
        noisy = {
            name: values
            + largest * (noise * random.normal(size=400) + ripple * np.sin(ahead / 1e-3 + 6 * random.random()))
            for name, values in strain.items()
        }
        result.append(Trace(0.1 + direction * x, 3.5e-3, time, noisy))
    return result


def check(found: FrontFit, fraction: float, tolerance: float) -> None:
    speed = fraction * MEDIUM.c_R
    assert found.fracture_energy == pytest.approx(GAMMA, rel=tolerance)
    assert found.speed == pytest.approx(speed, rel=tolerance)
    intensity = stress_intensity(GAMMA, MEDIUM.modulus, A_II(speed, MEDIUM.c_p, MEDIUM.c_s))
    assert found.K_II / intensity == pytest.approx(1, rel=tolerance)
    assert found.tip(np.array([PASSAGE]))[0] == pytest.approx(0.1, abs=7e-3 * tolerance)


@pytest.mark.parametrize("fraction", [*(pytest.param(v, marks=pytest.mark.slow) for v in (0.1, 0.5)), 0.95])
def test_exact(fraction: float) -> None:
    check(fit_front(traces(fraction), MEDIUM), fraction, 2e-3)


@pytest.mark.parametrize("fraction", [pytest.param(0.3, marks=pytest.mark.slow), 0.9])
def test_noise(fraction: float) -> None:
    found = fit_front(traces(fraction, noise=0.03), MEDIUM)
    check(found, fraction, 0.05)
    # The truth is within three standard errors, and these are not idle.
    assert abs(found.fracture_energy - GAMMA) < 3 * found.fracture_energy_error < 0.2 * GAMMA
    assert abs(found.speed / MEDIUM.c_R - fraction) < 3 * found.speed_error / MEDIUM.c_R < 0.05


def test_the_error_of_the_energy_is_twice_that_of_the_intensity_where_fronts_are_slow() -> None:
    """Gamma = A(v) K^2 / E*: dGamma / Gamma = 2 dK / K + dA / A, and A = 1 + O(v^2) hardly changes with the speed."""
    found = fit_front(traces(0.1, noise=0.03), MEDIUM)
    relative = found.fracture_energy_error / found.fracture_energy, found.K_II_error / found.K_II
    assert relative[0] == pytest.approx(2 * relative[1], rel=1e-3) and relative[1] > 1e-3


def test_errors_know_what_the_front_does_not_explain() -> None:
    """A ripple of 6 mm, other in every trace, is not independent from sample to sample."""
    off = [
        (found.fracture_energy - GAMMA) / found.fracture_energy_error
        for found in (fit_front(traces(0.7, ripple=size), MEDIUM) for size in (0.02, 0.05, -0.05))
    ]
    assert np.abs(off).max() < 3


def test_towards_the_left() -> None:
    check(fit_front(traces(0.5, direction=-1), MEDIUM, direction=-1), 0.5, 2e-3)


def test_process_zone() -> None:
    found = fit_front(traces(0.5, zone=2e-3), MEDIUM)
    assert found.process_zone == pytest.approx(2e-3, rel=0.02)
    assert found.fracture_energy == pytest.approx(GAMMA, rel=5e-3)


def plane_wave() -> list[Trace]:
    """A pulse of shear that passes all gauges at c_s: no front."""
    time = np.linspace(0, 1e-4, 400)
    return [Trace(x, 3.5e-3, time, {name: factor * np.exp(-(((time - 5e-5 - x / MEDIUM.c_s) / 5e-6) ** 2))
            for name, factor in (("xx", 1e-4), ("yy", 1e-4), ("xy", 2e-4))}) for x in (-4e-3, 0.0, 4e-3)]  # fmt: skip


def noise_alone() -> list[Trace]:
    random = np.random.default_rng(3)
    strain = {name: 1e-5 * random.normal(size=400) for name in ("xx", "xy")}
    return [Trace(0.0, 3.5e-3, np.linspace(0, 1e-4, 400), strain)]


def changed(**parts: object) -> list[Trace]:
    first = traces(0.5)[0]
    return [Trace(**{"x": first.x, "y": first.y, "time": first.time, "strain": first.strain, **parts})]


def before_the_front() -> list[Trace]:
    """Only what is long before."""
    return [Trace(t.x, t.y, t.time[:120], {k: v[:120] for k, v in t.strain.items()}) for t in traces(0.5, noise=0.02)]


@pytest.mark.parametrize("make, text", [
    (noise_alone, "front_fit: (a front explains|fracture energy|the tip would pass|speed)"),
    (plane_wave, "front_fit: (a front explains|speed|fracture energy)"),
    (before_the_front, "front_fit: (a front explains|fracture energy|the tip would pass|speed|.* samples lie near)"),
    (list, "no trace was given"),
    (lambda: changed(y=0.0), r"trace 1: y = 0 m: the gauge must be above"),
    (lambda: changed(strain={}), "no strain; give some of xx, yy, xy"),
    (lambda: changed(strain={"zz": np.zeros(400)}), "strain 'zz': must be one of"),
    (lambda: changed(strain={"xx": np.full(400, np.nan)}), "400 finite numbers are needed"),
    (lambda: changed(time=traces(0.5)[0].time[::-1]), "400 times: at least 12 that increase"),
    (lambda: changed(strain={"xx": np.full(400, 1e-3)}), "the traces are constant"),
    (lambda: changed(strain={"xx": 1e6 * traces(0.5)[0].strain["xx"]}), "'xx' is up to .* is it in microstrain"),
    (lambda: changed(strain={"xx": DataArray(np.zeros(400))}), r"strain 'xx' has no units: must be '1'; .*\.attrs"),
    (lambda: changed(time=DataArray(np.arange(400.0), attrs={"units": "us"})), "time has units = 'us': must be 's'"),
])  # fmt: skip
def test_refuses(make: Callable[[], list[Trace]], text: str) -> None:
    with pytest.raises(RuptfxError, match=facts(text)):
        fit_front(make(), MEDIUM)


def test_a_fit_that_does_not_converge_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Least squares that stop after two evaluations say so; their values were taken as those of the front."""
    whole = front_fit.least_squares

    def stopped(*given: Any, **options: Any) -> Any:
        return whole(*given, **options, max_nfev=2)

    monkeypatch.setattr(front_fit, "least_squares", stopped)
    with pytest.raises(RuptfxError, match=r"^front_fit:.*\b2\b.*less\snoise"):
        fit_front(traces(0.7), MEDIUM)
