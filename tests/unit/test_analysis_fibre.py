"""Shear lag of a fibre: elastic limit, energy of a sliding zone, the critical length against the modes of a chain."""

from __future__ import annotations

from dataclasses import replace
from math import log, pi

import numpy as np
import pytest

from ruptfx import RuptfxError
from ruptfx.results.analysis.fibre import ShearLag

FIBRE = ShearLag(1e-3, 5e-3, 30e-3, 70e9, 1.2e9)


def bar_matrix(fibre: ShearLag, points: int) -> np.ndarray:
    """(E R / 2) u'' as a matrix over u at x = h, 2 h ... L, with u(0) = 0 and u'(L) = 0 [Pa/m]."""
    h = fibre.length / points
    second = np.diag(np.full(points, -2.0)) + np.diag(np.ones(points - 1), 1) + np.diag(np.ones(points - 1), -1)
    second[-1, -2:] = 2, -2
    return 0.5 * fibre.young_modulus * fibre.radius * second / h**2


def test_before_sliding_force_is_stiffness_times_displacement() -> None:
    moved, force = FIBRE.pulled(6e6, np.zeros(1))
    assert force[0] == pytest.approx(FIBRE.elastic_stiffness() * moved[0], rel=1e-12)
    # A long one: pi R^2 E / lambda, lambda^2 = E R^2 ln(R_o / R) / (2 G).
    long = replace(FIBRE, length=1.0)
    decay = 1e-3 * np.sqrt(70e9 * log(5) / (2 * 1.2e9))
    assert long.elastic_stiffness() == pytest.approx(pi * 1e-6 * 70e9 / decay, rel=1e-9)


def test_partial_sliding_against_finite_differences() -> None:
    """u'' = tau / (E R / 2), tau = strength where u is more than strength / k, else k u; the end at x = 0 is given."""
    strength, points = 6e6, 3000
    moved, force = FIBRE.pulled(strength, np.array([12e-3]))
    h, k = FIBRE.length / points, FIBRE.matrix_stiffness
    A = bar_matrix(FIBRE, points)
    x = h * np.arange(1, points + 1)
    slides = x < 12e-3
    load = np.where(slides, strength, 0.0)
    load[0] -= 0.5 * FIBRE.young_modulus * FIBRE.radius * moved[0] / h**2
    u = np.linalg.solve(A - np.diag(np.where(slides, 0.0, k)), load)
    assert np.all(k * u[slides] >= 0.999 * strength) and np.all(k * u[~slides] <= 1.001 * strength)
    tau = np.where(slides, strength, k * u)
    assert 2 * pi * FIBRE.radius * h * tau.sum() == pytest.approx(force[0], rel=2e-3)


def test_all_of_it_slides_at_the_strength_of_its_surface() -> None:
    _, force = FIBRE.pulled(6e6, np.array([FIBRE.length]))
    assert force[0] == pytest.approx(2 * pi * FIBRE.radius * FIBRE.length * 6e6, rel=1e-12)


def test_a_debonding_crack_releases_the_energy_of_the_bond() -> None:
    """F^2 / 2 dC/dl = 2 pi R energy at any length of the crack, and sqrt(4 E energy / R) of a long fibre."""
    energy, at, step = 50.0, 12e-3, 1e-6
    moved, force = FIBRE.pulled(0.0, np.array([at - step, at, at + step]), energy)
    compliance = moved / force
    released = 0.5 * force[1] ** 2 * (compliance[2] - compliance[0]) / (2 * step)
    assert released == pytest.approx(2 * pi * FIBRE.radius * energy, rel=1e-6)
    _, long = replace(FIBRE, length=1.0).pulled(0.0, np.array([at]), energy)
    assert long[0] == pytest.approx(pi * 1e-6 * np.sqrt(4 * 70e9 * energy / 1e-3), rel=1e-9)


def test_critical_length_is_where_the_softest_mode_is_neutral() -> None:
    weakening = 1.6e11
    fibre = replace(FIBRE, length=FIBRE.critical_length(weakening))
    bar = np.min(-np.linalg.eigvals(bar_matrix(fibre, 400)).real)
    assert 1 / (1 / bar + 1 / fibre.matrix_stiffness) == pytest.approx(weakening, rel=1e-4)
    with pytest.raises(RuptfxError, match=r"critical_length: .*1e\+13 Pa/m"):
        FIBRE.critical_length(1e13)
