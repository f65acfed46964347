"""The point of an interface that is nearest to a given one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.platform import fem

FARTHEST = 0.01  # of its extent: largest distance from the interface of a point that defines a position


def nearest_on_line(face: Interface, comm: fem.MPI.Comm, point: np.ndarray) -> tuple[float, np.ndarray]:
    """Return position [m] and coordinates of the nearest point of a 2D interface; collective.

    Parameters
    ----------
    face : Interface
    comm : MPI communicator
    point : ndarray, shape (2,)

    Raises
    ------
    RuptfxError
        On all ranks, if it is farther than a hundredth of the extent of the interface.
    """
    rows = np.column_stack([face.number, face.position, face.points])[face.owned]
    rows = parallel.share_rows(comm, rows)
    _, position, *xy = rows[np.argsort(rows[:, 0])].T
    corners = np.stack(xy, axis=1)
    begin, side = corners[:-1], np.diff(corners, axis=0)
    part = np.clip(np.sum((point - begin) * side, axis=1) / np.sum(side**2, axis=1), 0, 1)
    feet = begin + part[:, None] * side
    away = np.linalg.norm(point - feet, axis=1)
    best, limit = int(np.argmin(away)), FARTHEST * np.ptp(corners, axis=0).max()
    if away[best] > limit:
        raise RuptfxError(
            f"({point[0]:.6g}, {point[1]:.6g}) m is {away[best]:.4g} m from the interface, at most {limit:.4g} m "
            f"(a hundredth of its extent) are taken; its nearest point is ({feet[best, 0]:.12g}, "
            f"{feet[best, 1]:.12g}) m"
        )
    return float(position[best] + part[best] * (position[best + 1] - position[best])), feet[best]


def nearest_on_surface(face: Interface, comm: fem.MPI.Comm, point: np.ndarray) -> np.ndarray:
    """Return both positions [m] of a point near a surface, shape (2,); collective.

    They are those of the nearest node plus the distances from it along the tangents there, exact on a plane.

    Raises
    ------
    RuptfxError
        On all ranks, if the point is farther than a hundredth of the extent from the surface, or beyond its rim.
    """
    frame = face.frame.reshape(-1, 9)
    rows = np.column_stack([face.number, face.locations, face.points, frame])[face.owned]
    rows = parallel.share_rows(comm, rows)
    rows = rows[np.argsort(rows[:, 0])]
    points = rows[:, 3:6]
    best = int(np.argmin(np.linalg.norm(points - point, axis=1)))
    normal, *tangents = rows[best, 6:].reshape(3, 3)
    away, limit = abs(float((point - points[best]) @ normal)), FARTHEST * np.ptp(points, axis=0).max()
    result = rows[best, 1:3] + np.stack(tangents) @ (point - points[best])
    low, high = rows[:, 1:3].min(axis=0) - limit, rows[:, 1:3].max(axis=0) + limit
    if away > limit or np.any(result < low) or np.any(result > high):
        here, there = (", ".join(f"{value:.12g}" for value in each) for each in (point, points[best]))
        raise RuptfxError(f"({here}) m is not on the interface, whose nearest node is ({there}) m")
    return np.asarray(result)
