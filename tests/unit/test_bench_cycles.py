"""What the benchmark of seismic cycles compares with: stress of dislocations, steady creep, ruptures in a history."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks._cycles import Cycles
from benchmarks._half_space_fault import DippingFault, HalfSpaceFault, edge_dislocation

G, C_S, SIGMA, V_P = 32e9, 3464.0, 50e6, 1e-9


def fault(cells: np.ndarray) -> HalfSpaceFault:
    """Velocity strengthening, at the steady traction of the rate of the plates."""
    a, b, D_c, f_0, V_0 = 0.02, 0.015, 8e-3, 0.6, 1e-6
    steady = a * SIGMA * np.arcsinh(V_P / (2 * V_0) * np.exp((f_0 + b * np.log(V_0 / V_P)) / a))
    return HalfSpaceFault(cells, np.full(len(cells) - 1, a), b, D_c, f_0, V_0, SIGMA, G, C_S, V_P, steady)


def test_stress_of_a_surface_dislocation() -> None:
    """Slip s from the surface to depth D, at depth z: G s / (2 pi) (1/(z - D) - 1/(z + D)); its ends at the surface
    cancel with their images."""
    cells, D, s = np.linspace(0, 10e3, 101), 4e3, 2.0
    z = 0.5 * (cells[1:] + cells[:-1])
    expected = G * s / (2 * np.pi) * (1 / (z - D) - 1 / (z + D))
    np.testing.assert_allclose(fault(cells).stiffness() @ np.where(z < D, s, 0.0), expected, rtol=1e-10)


def test_stress_of_an_edge_dislocation() -> None:
    """Far below the surface sigma_xy = G b / (2 pi (1 - nu) x) ahead of it; the surface has no traction."""
    at, b, nu = np.array([3e3 - 1e9j]), 2.0, 0.25
    xx, yy, xy = edge_dislocation(at + 500.0, at, b + 0j, G, nu).ravel()
    assert xy == pytest.approx(G * b / (2 * np.pi * (1 - nu) * 500.0), rel=1e-5)
    assert abs(xx) < 1e-5 * xy and abs(yy) < 1e-5 * xy
    surface = np.linspace(-5e3, 5e3, 21) + 0j
    stress = edge_dislocation(surface, np.array([300.0 - 2e3j]), 1.0 + 0.5j, G, nu)
    assert np.abs(stress[1:]).max() < 1e-12 * np.abs(stress[0]).max()


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_stress_of_a_dipping_fault(sense: float) -> None:
    """Slip takes shear stress away where it is; locked above slip, a thrust is pressed together and a normal fault not.

    In the middle of a deep cell of the width w the shear stress by its own slip is -2 G / (pi (1 - nu) w).
    """
    cells = np.linspace(0, 20e3, 101)
    dipping = DippingFault(
        cells, np.full(100, 0.01), 0.015, 8e-3, 0.6, 1e-6, SIGMA, G, C_S, V_P, 3e7, np.deg2rad(60.0), 0.25, sense
    )  # fmt: skip
    K, N = dipping.stiffness(), dipping.normal_stiffness()
    assert K[-1, -1] == pytest.approx(-2 * G / (np.pi * 0.75 * 200.0), rel=0.01)
    locked = np.where(cells[:-1] < 10e3, -1.0, 0.0)  # slip less than that of the plates
    assert np.all(sense * (N @ locked)[:20] > 0) and np.all((K @ locked)[:49] > 0)


def test_age_and_slip_rate_are_inverse_and_steady() -> None:
    """At the steady traction theta = D_c / V_p; with radiation on top the law gives V_p back."""
    of = fault(np.linspace(0, 1e3, 11))
    age = of.initial_age()
    np.testing.assert_allclose(np.exp(age), of.D_c / V_P, rtol=1e-9)
    traction = np.full(10, of.initial_traction + G / (2 * C_S) * V_P)
    found = of.log_rate(traction, age, np.zeros(10))
    np.testing.assert_allclose(np.exp(found), V_P, rtol=1e-9)


def test_ruptures_in_a_history() -> None:
    """Two, of which the second goes on: onset, depth, zone, peak and slip of the first."""
    found, slip = Cycles(np.array([0.0, 1.0, 2.0, 3.0])), np.zeros(4)
    shape = np.array([0.01, 0.2, 1.0, 0.5])
    for step, fastest in enumerate([1e-9, 2e-3, 3.0, 1e-3, 1e-5, 1e-9, 5e-3], start=1):
        slip = slip + shape * fastest
        found.look(10.0 * step, shape * fastest, slip)
    first, second = found.events
    assert (first.onset, first.depth, first.nucleation, first.first_step) == (20.0, 2.0, 2.0, 2)
    assert first.peak == 3.0 and first.slip == pytest.approx(3.0 + 1e-3 + 1e-5)
    assert found.over == 1 and second.onset == 70.0 and second.slip == 0
    assert first.first_slip == pytest.approx(0.01 * (3.0 + 1e-3 + 1e-5))
    np.testing.assert_array_equal(found.intervals, [50.0])
    # Profiles of slip: the first, both where a rupture begins and ends, and every second in one.
    kept = [(profile.time, profile.ruptures) for profile in found.profiles]
    assert kept == [(10.0, False), (20.0, True), (30.0, True), (40.0, True), (50.0, False), (70.0, True)]
    np.testing.assert_array_equal(found.profiles[-1].slip, slip)
