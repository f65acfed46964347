"""Meshes whose elements have no two edges or faces that are parallel."""

from __future__ import annotations

import numpy as np


def twist(x: np.ndarray, dim: int, size: float = 0.05) -> None:
    """Move the points of a mesh so that the maps of its elements have all their terms, those with zeta too.

    Parameters
    ----------
    x : ndarray, shape (points, 3)
        Points of a mesh with a length of about 1, changed in place.
    dim : int
        Number of coordinates that move.
    size : float
        Largest motion along an axis.
    """
    a, b, c = x.T.copy()
    x[:, 0] = a + size * np.sin(5 * b + 3 * c + 2 * a + a * b * c)
    x[:, 1] = b + size * np.sin(4 * a * (1 + c) + 2 * c)
    if dim == 3:
        x[:, 2] = c + size * np.sin(3 * a + 5 * b + 7 * a * b)
