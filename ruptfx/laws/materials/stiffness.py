"""Tangent stiffness of a material from its energy, and the corresponding waves."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import CaseError

if TYPE_CHECKING:
    from ruptfx.laws.materials import Material, Plane


@lru_cache
def tangent_stiffness(material: Material, plane: Plane) -> np.ndarray:
    """Return the second derivative of the strain energy density at zero strain [Pa].

    Parameters
    ----------
    material : Material
    plane : str
        For axisymmetric bodies the stiffness in the section, that of plane strain.

    Returns
    -------
    ndarray, shape (d, d, d, d); in antiplane (d, d)
        C_ijkl with the symmetries of strain.

    Raises
    ------
    RuptfxError
        An energy that depends on more than the strain.
    """
    return _second_derivative(material, "strain" if plane == "axisymmetric" else plane, 0.0)


@lru_cache
def linear_stiffness(material: Material, plane: Plane) -> np.ndarray:
    """Return the stiffness of a linear material, as `tangent_stiffness`, for axisymmetric bodies that of 3D [Pa].

    Raises
    ------
    RuptfxError
        A second derivative that differs between strains of zero and of the order of one.
    """
    plane = "solid" if plane == "axisymmetric" else plane
    stiffness = tangent_stiffness(material, plane)
    strained = _second_derivative(material, plane, 1.0)
    if not np.allclose(strained, stiffness, rtol=1e-12, atol=1e-12 * np.abs(stiffness).max()):
        raise RuptfxError(f"material '{material.kind()}': its stiffness varies with the strain")
    return stiffness


def least_stiffness(material: Material, plane: Plane) -> tuple[float, float]:
    """Return the smallest and the largest eigenvalue of the stiffness at zero strain [Pa].

    They are twice the energies of strains of norm one. Axisymmetric bodies have those of 3D, as hoop strain counts.

    Raises
    ------
    RuptfxError
        An energy that depends on more than the strain.
    """
    stiffness = tangent_stiffness(material, "solid" if plane == "axisymmetric" else plane)
    if stiffness.ndim == 4:
        pairs = [(i, j) for i in range(len(stiffness)) for j in range(i + 1)]
        size = np.sqrt([1.0 if i == j else 2.0 for i, j in pairs])  # of a strain whose norm counts both entries
        stiffness = np.outer(size, size) * [[stiffness[(*row, *column)] for column in pairs] for row in pairs]
    moduli = np.linalg.eigvalsh(stiffness)
    return float(moduli[0]), float(moduli[-1])


def require_positive_energy(material: Material, plane: Plane, key: str = "") -> None:
    """Refuse a material of which some strain would release energy.

    A material whose stiffness does not follow from its energy alone is accepted.

    Raises
    ------
    CaseError
        Names the key and the smallest stiffness.
    """
    try:
        least, largest = least_stiffness(material, plane)
    except RuptfxError:
        return
    if least <= 1e-13 * largest:  # rounding of the eigenvalues
        raise CaseError(
            f"{key or material.kind()}: some strain has the stiffness {least:.4g} Pa in plane = '{plane}', which must "
            f"be positive (the largest is {largest:.4g} Pa): it would release energy; change the elastic constants"
        )


def _second_derivative(material: Material, plane: Plane, size: float) -> np.ndarray:
    """Return the symmetric second derivative of the strain energy density at a strain of some size [Pa]."""
    import ufl

    dim = 3 if plane == "solid" else 2
    value = size * np.cos(np.arange(dim**2)).reshape(dim, dim)
    value = value[0] if plane == "antiplane" else 0.5 * (value + value.T)
    strain = ufl.variable(ufl.as_tensor(value.tolist()))
    try:
        slope = ufl.diff(material.energy_density(strain, plane), strain)
        tangent = ufl.algorithms.expand_derivatives(ufl.diff(slope, strain))
        origin = (0.0,) * dim
        values = [float(tangent(origin, component=entry)) for entry in np.ndindex(tangent.ufl_shape)]
        stiffness = np.reshape(values, tangent.ufl_shape)
        if not np.all(np.isfinite(stiffness)):
            raise ValueError(f"it must be finite at {'zero strain' if size == 0 else f'strains of {size:g}'}")
        _refuse_places(tangent)
    except Exception as error:
        raise RuptfxError(
            f"material '{material.kind()}': its stiffness does not follow from its energy alone ({error}), which "
            "absorbing edges and radiation damping need; define its methods `impedance` and `wave_speeds`"
        ) from None
    if stiffness.ndim == 4:
        stiffness = 0.5 * (stiffness + stiffness.swapaxes(0, 1))
        stiffness = 0.5 * (stiffness + stiffness.swapaxes(2, 3))
    stiffness.setflags(write=False)
    return stiffness


def christoffel(stiffness: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the Christoffel tensor n_j C_ijkl n_l [Pa], shape (..., components, components)."""
    if stiffness.ndim == 2:
        return np.einsum("...j,jl,...l", normal, stiffness, normal)[..., None, None]
    return np.einsum("...j,ijkl,...l->...ik", normal, stiffness, normal)


def in_frame(stiffness: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return the stiffness of plane or solid bodies in other axes, the rows of a frame, shape (d, d)."""
    return np.asarray(np.einsum("ai,bj,ck,dl,ijkl->abcd", frame, frame, frame, frame, stiffness, optimize=True))


def surface_wave_speed(stiffness: np.ndarray, density: float) -> float:
    """Return the speed along x of the wave at a free surface with normal y, or of the slowest bulk wave [m/s].

    Motion a exp(i k (x + p y - v t)) solves (Q - rho v^2 + p (R + R') + p^2 T) a = 0 with Q = C_i1k1, R = C_i1k2,
    T = C_i2k2, and exerts the traction i k (R' + p T) a. Of motions that decay away from the surface, the matrix Z from
    motion to traction is Hermitian; its eigenvalues are positive at rest and fall with v, and where the first one is
    zero a wave needs no traction.
    Source: Lothe and Barnett (1976), J. Appl. Phys. 47; Ting (1996), Anisotropic elasticity, chapters 5 and 12.

    Parameters
    ----------
    stiffness : ndarray, shape (d, d, d, d)
        [Pa].
    density : float
        [kg/m3].
    """
    Q, R, T = stiffness[:, 0, :, 0], stiffness[:, 0, :, 1], stiffness[:, 1, :, 1]
    one = np.eye(len(Q))

    def slower(speed: float) -> bool:
        """Return whether the surface wave is faster than this speed."""
        inverse = np.linalg.inv(T)
        companion = np.block([[0 * one, one], [-inverse @ (Q - density * speed**2 * one), -inverse @ (R + R.T)]])
        p, motion = np.linalg.eig(companion)
        decaying = p.imag > 1e-9
        if np.count_nonzero(decaying) < len(Q):
            return False  # a bulk wave radiates from the surface
        a = motion[: len(Q), decaying]
        impedance = -1j * (R.T @ a + T @ a * p[decaying]) @ np.linalg.inv(a)
        return float(np.linalg.eigvalsh(impedance)[0]) > 0

    low, high = 0.0, float(np.sqrt(np.linalg.eigvalsh(Q)[0] / density))
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slower(middle) else (low, middle)
    return low


def _refuse_places(expression: object) -> None:
    """Refuse an energy that depends on the position: its value at the origin is not that at an edge."""
    from ufl.corealg.traversal import traverse_unique_terminals
    from ufl.geometry import GeometricQuantity

    if any(isinstance(item, GeometricQuantity) for item in traverse_unique_terminals(expression)):
        raise ValueError("it varies from place to place")
