"""Nearest neighbours of points, with a fast path for points that coincide up to rounding, as interface nodes do.

Other points need SciPy's tree, whose import takes as long as that of DOLFINx.
"""

from __future__ import annotations

import numpy as np

Found = tuple[np.ndarray, np.ndarray]
ROUNDING = 1e-10  # of their largest coordinate, up to which points coincide


def closest(points: np.ndarray, others: np.ndarray) -> Found:
    """Return the distance from every point to the nearest of others, and its index.

    Parameters
    ----------
    points, others : ndarray, shapes (n, dim) and (m, dim)
        At least one other.

    Returns
    -------
    distance, number : ndarray, shape (n,)
    """
    coinciding = _coinciding(points, others)
    if coinciding is not None:
        return coinciding
    from scipy.spatial import cKDTree

    distance, number = cKDTree(others).query(points)
    return distance, number


def _coinciding(points: np.ndarray, others: np.ndarray) -> Found | None:
    """Return the same for coinciding point sets; None if any point has no unique match."""
    dim = others.shape[1]
    direction = np.sqrt([2.0, 3.0, 5.0])[:dim]  # along which no two points of a mesh are expected to be alike
    close = ROUNDING * max(np.abs(others).max(initial=0.0), np.abs(points).max(initial=0.0))
    along = others @ direction
    order = np.argsort(along)
    reach = close * direction.sum()
    single = np.diff(along[order], prepend=-np.inf) > 2 * reach  # the first of coinciding points
    along, order = along[order][single], order[single]
    number = order[np.minimum(np.searchsorted(along, points @ direction - reach), len(along) - 1)]
    distance = np.linalg.norm(points - others[number], axis=1)
    return (distance, number) if distance.max(initial=0.0) <= close else None
