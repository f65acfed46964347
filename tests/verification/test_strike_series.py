"""Fourier series along strike: closed forms of a plane fault, sections without change along strike, the 3D mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from ruptfx.bodies.boundaries.driven import Driven
from ruptfx.bodies.meshes.half_plate import HalfPlate
from ruptfx.interfaces.section import Section
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.platform import fem
from ruptfx.stepping.implicit.strike_series import StrikeSeries

pytestmark = pytest.mark.fem

G, NU = 30e9, 0.25
ROCK = {"default": IsotropicElastic(young_modulus=2 * G * (1 + NU), poisson_ratio=NU, density=2670.0)}


def half_space(size: float, height: float = 6.0) -> Section:
    """One half of a whole space with a plane fault of length 1 along x, between planes of symmetry."""
    held = [Driven(edge=f"upper.{side}", component="x", velocity=0.0) for side in ("left", "right")]
    far = [Driven(edge="upper.top", component=axis, velocity=0.0) for axis in "xyz"]
    mesh = HalfPlate(length=1.0, height=height, element_size=size, growth=1.15)
    return Section(mesh, ROCK, 2, [*held, *far])


def series(section: Section, folder: Path, period: float = 2 * np.pi, points: int = 16) -> StrikeSeries:
    face = section.faces["main"]
    nearly_rigid = np.full((len(face.plus), 3), 1 / (1e9 * G))
    return StrikeSeries(section, ["main"], nearly_rigid, period, points, fem.MPI.COMM_WORLD, folder)


@pytest.mark.parametrize(("q", "k", "bound"), [
    (0, 2, 1e-5), (0, 5, 3e-5), (np.pi, 2, 1e-4), (np.pi, 5, 1e-4), (2 * np.pi, 1, 1.5e-3),
])  # fmt: skip
def test_closed_form_of_strike_slip(q: float, k: int, bound: float, tmp_path: Path) -> None:
    """G kappa / 2 ((k / kappa)^2 / (1 - nu) + (q / kappa)^2) for slip along strike cos(q x) sin(k z)."""
    K = series(half_space(1 / 8), tmp_path)
    x = K.section.faces["main"].points[:, 0]
    z = 2 * np.pi * np.arange(16) / 16
    pattern = np.cos(q * x) * np.sin(k * z)[:, None]
    slip = np.stack([pattern, 0 * pattern], axis=2)
    traction = K.traction(slip)[..., 1]
    kappa = np.hypot(q, k)
    expected = 0.5 * G * kappa * ((k / kappa) ** 2 / (1 - NU) + (q / kappa) ** 2)
    weight = np.broadcast_to(K.weight[::3], pattern.shape)
    measured = np.sum(weight * traction * pattern) / np.sum(weight * pattern**2)
    assert measured == pytest.approx(expected, rel=bound)
