"""Photoelasticity: the isochromatic fringes that a polariscope shows of a plane stress field.

The stress-optic law N = h (sigma_1 - sigma_2) / f_sigma counts fringes; a circular polariscope with crossed
analyser (dark field) passes sin^2(pi N) of the light, with parallel analyser (light field) cos^2(pi N).
Source: J. W. Dally and W. F. Riley, Experimental Stress Analysis.
"""

from __future__ import annotations

import numpy as np

from ruptfx import RuptfxError

Array = np.ndarray


def principal_difference(xx: Array, yy: Array, xy: Array) -> Array:
    """sigma_1 - sigma_2 = sqrt((xx - yy)^2 + 4 xy^2) of the stresses in the plane [Pa]."""
    return np.hypot(xx - yy, 2 * xy)


def difference_of(stress: Array) -> Array:
    """sigma_1 - sigma_2 in the plane of x and y [Pa]; in antiplane twice the shear stress.

    Parameters
    ----------
    stress : ndarray, shape (n, components)
        xz and yz, or xx, yy and xy (and zz around an axis), or xx, yy, zz, xy, yz and xz.
    """
    if stress.shape[1] == 2:
        return 2 * np.hypot(stress[:, 0], stress[:, 1])
    return principal_difference(stress[:, 0], stress[:, 1], stress[:, 3 if stress.shape[1] == 6 else 2])


def principal_direction(xx: Array, yy: Array, xy: Array) -> Array:
    """Angle of sigma_1 from x [rad], between -pi / 2 and pi / 2: tan(2 theta) = 2 xy / (xx - yy)."""
    return 0.5 * np.arctan2(2 * xy, xx - yy)


def fringe_order(difference: Array, fringe_constant: Array | float, thickness: float) -> Array:
    """Return the number of fringes N = h (sigma_1 - sigma_2) / f_sigma.

    Parameters
    ----------
    difference : ndarray
        sigma_1 - sigma_2 [Pa].
    fringe_constant : ndarray or float
        f_sigma of the material and the light [N/m].
    thickness : float
        Thickness of the plate [m].
    """
    return difference * (thickness / fringe_constant)


def intensity(order: Array, field: str = "dark") -> Array:
    """Return the transmitted light from 0 to 1: sin^2(pi N) in a dark field, cos^2(pi N) in a light field.

    Parameters
    ----------
    order : ndarray
        Fringe order N.
    field : str
        "dark" (no stress is black) or "light".

    Raises
    ------
    RuptfxError
        Another field.
    """
    if field not in ("dark", "light"):
        raise RuptfxError(f"photoelasticity: field = '{field}': must be 'dark' or 'light'")
    wave = np.sin if field == "dark" else np.cos
    return wave(np.pi * order) ** 2


def plane_intensity(order: Array, direction: Array, polariser: float) -> Array:
    """Return the light of a plane polariscope with crossed analyser, sin^2(2 (theta - alpha)) sin^2(pi N).

    Isoclinics, where a principal direction is that of the polariser, are black at any order.

    Parameters
    ----------
    order : ndarray
        Fringe order N.
    direction : ndarray
        Of a principal stress, theta [rad].
    polariser : float
        Its angle alpha [rad].
    """
    return np.sin(2 * (direction - polariser)) ** 2 * intensity(order)
