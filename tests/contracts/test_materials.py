"""What every material promises: impedances that belong to its energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from examples import table

pytest.importorskip("dolfinx")

import ufl

from ruptfx import RuptfxError, fem
from ruptfx.materials import Material, Plane
from ruptfx.materials.isotropic_elastic import IsotropicElastic
from ruptfx.schema import alternatives

pytestmark = pytest.mark.fem

PLANES: tuple[Plane, ...] = ("stress", "strain", "antiplane", "solid")
KINDS = alternatives("ruptfx.materials")


def normals(plane: Plane) -> np.ndarray:
    n = np.random.default_rng(1).normal(size=(5, 3 if plane == "solid" else 2))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("kind", KINDS)
def test_impedance_belongs_to_the_energy(kind: str, plane: Plane) -> None:
    """Z Z = rho times the Christoffel tensor: p' Z Z p / rho is twice the energy of the small strain sym(p n')."""
    material: Any = KINDS[kind].model_validate(table(KINDS[kind]))
    n = normals(plane)
    impedance = material.impedance(n, plane)
    np.testing.assert_allclose(impedance, impedance.swapaxes(1, 2), rtol=1e-12)
    assert np.linalg.eigvalsh(impedance).min() > 0
    for normal, z in zip(n, impedance, strict=True):
        p = 1e-6 * np.random.default_rng(2).normal(size=len(z))
        strain = p[0] * normal if plane == "antiplane" else 0.5 * (np.outer(p, normal) + np.outer(normal, p))
        energy = float(material.energy_density(ufl.as_tensor(strain.tolist()), plane)((0.0,) * len(normal)))
        assert p @ z @ z @ p / material.density == pytest.approx(2 * energy, rel=1e-5)


@pytest.mark.parametrize("plane", PLANES)
def test_isotropic_impedance(plane: Plane) -> None:
    """rho c_p along the normal and rho c_s across."""
    material = IsotropicElastic(young_modulus=5.3e9, poisson_ratio=0.35, density=1246.0)
    speeds, n = material.wave_speeds(plane), normals(plane)
    along = n[:, :, None] * n[:, None, :] if plane != "antiplane" else np.zeros((len(n), 1, 1))
    expected = material.density * (speeds.c_p * along + speeds.c_s * (np.eye(along.shape[1]) - along))
    np.testing.assert_allclose(material.impedance(n, plane), expected, rtol=1e-13, atol=1e-13 * expected.max())


class Graded(Material):
    """Stiffness that varies from place to place."""

    def energy_density(self, strain: Any, plane: Plane) -> Any:
        x = ufl.SpatialCoordinate(ufl.Mesh(fem.basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))))
        return (1e9 + 1e6 * x[0]) * ufl.inner(strain, strain)


class Unstable(Material):
    def energy_density(self, strain: Any, plane: Plane) -> Any:
        return 1e9 * (ufl.inner(strain, strain) - 2 * ufl.tr(strain) ** 2)


@pytest.mark.parametrize(
    "material, message",
    [
        (Graded(density=1e3), r"does not follow from its energy alone \(it varies from place to place\).*`impedance`"),
        (Unstable(density=1e3), r"some plane waves have a modulus of -2e\+09 Pa"),
    ],
)  # fmt: skip
def test_impedances_that_are_not_known(material: Material, message: str) -> None:
    with pytest.raises(RuptfxError, match=message):
        material.impedance(np.eye(2), "strain")
