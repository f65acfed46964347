"""Displacement of the surface of a half-space by uniform slip on dipping rectangles.

Independent of the finite elements, as a reference for them.
Source: Okada (1985), Surface deformation due to shear and tensile faults in a half-space, Bull. Seismol. Soc. Am. 75,
equations 24 to 30.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def surface_displacement(
    x: Array, y: Array, bottom: tuple[Array, Array, Array], size: tuple[float, float], dip: float,
    slip: tuple[Array, Array], poisson_ratio: float,
) -> Array:  # fmt: skip
    """Return the displacement of surface points [m], shape (points, 3), summed over rectangles.

    The strike is along x and rectangles dip towards -y; z points upwards.

    Parameters
    ----------
    x, y : ndarray, shape (points,)
        [m]
    bottom : three ndarrays, shape (rectangles,)
        x and y of the lower corner from which a rectangle goes along x, and its depth [m].
    size : (float, float)
        Along strike and dip [m].
    dip : float
        [rad], below pi / 2.
    slip : two ndarrays, shape (rectangles,)
        Left-lateral slip, and that of a thrust [m].
    poisson_ratio : float
    """
    sine, cosine = np.sin(dip), np.cos(dip)
    away, across = x[:, None] - bottom[0], y[:, None] - bottom[1]
    p, q = across * cosine + bottom[2] * sine, across * sine - bottom[2] * cosine
    length, width = size
    total = np.zeros((len(x), 3))
    for shift, sign in ((0.0, 1.0), (length, -1.0)):
        for up, along in ((0.0, 1.0), (width, -1.0)):
            corner = _corner(away - shift, p - up, q, sine, cosine, 1 - 2 * poisson_ratio)
            total -= sign * along / (2 * np.pi) * np.einsum("kipr,kr->pi", corner, np.stack(slip))
    return total


def _corner(xi: Array, eta: Array, q: Array, sine: float, cosine: float, part: float) -> Array:
    """Return the terms of one corner for unit slip along strike and up dip, shape (2, 3, points, rectangles)."""
    R, X = np.sqrt(xi**2 + eta**2 + q**2), np.hypot(xi, q)
    y, d = eta * cosine + q * sine, eta * sine - q * cosine
    tangent = sine / cosine
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.where(q == 0, 0.0, np.arctan(xi * eta / (q * R)))
        last = np.arctan((eta * (X + q * cosine) + X * (R + X) * sine) / (xi * (R + X) * cosine))
        I_5 = np.where(xi == 0, 0.0, part * 2 / cosine * last)
    by_eta, by_xi = 1 / (R * (R + eta)), 1 / (R * (R + xi))
    I_4 = part / cosine * (np.log(R + d) - sine * np.log(R + eta))
    I_3 = part * (y / (cosine * (R + d)) - np.log(R + eta)) + tangent * I_4
    I_2 = -part * np.log(R + eta) - I_3
    I_1 = -part * xi / (cosine * (R + d)) - tangent * I_5
    along = [
        xi * q * by_eta + angle + I_1 * sine,
        y * q * by_eta + q * cosine / (R + eta) + I_2 * sine,
        d * q * by_eta + q * sine / (R + eta) + I_4 * sine,
    ]  # fmt: skip
    up = [
        q / R - I_3 * sine * cosine,
        y * q * by_xi + cosine * angle - I_1 * sine * cosine,
        d * q * by_xi + sine * angle - I_5 * sine * cosine,
    ]  # fmt: skip
    return np.array([along, up])
