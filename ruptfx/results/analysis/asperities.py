"""Arrival of a rupture at the contacts of a rough interface: at their outermost and their inner points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Asperity:
    """A contact: neighbouring points that are closed.

    Attributes
    ----------
    points : slice
        Points of the interface.
    center : float
        Its middle [m].
    width : float
        Distance of its outermost points [m].
    arrival : float
        First slip of one of its points [s], NaN where none slips.
    slipped : float
        Part of its points that slip.
    """

    points: slice
    center: float
    width: float
    arrival: float
    slipped: float


def asperities(position: Array, closed: Array, arrival: Array) -> list[Asperity]:
    """Return the contacts in order along the interface.

    Parameters
    ----------
    position : ndarray, shape (points,)
        Increasing [m].
    closed : ndarray of bool, shape (points,)
    arrival : ndarray, shape (points,)
        Time of first slip [s], NaN where none.
    """
    bounds = np.flatnonzero(np.diff(np.concatenate([[False], closed, [False]]).astype(int)))
    return [
        _asperity(slice(int(first), int(end)), position, arrival)
        for first, end in zip(bounds[::2], bounds[1::2], strict=True)
    ]


def _asperity(points: slice, position: Array, arrival: Array) -> Asperity:
    place, times = position[points], arrival[points]
    slips = np.isfinite(times)
    first = float(times[slips].min()) if slips.any() else float("nan")
    return Asperity(points, float(place[[0, -1]].mean()), float(np.ptp(place)), first, float(slips.mean()))


def first_slip(time: Array, slip_rate: Array, since: float, threshold: float) -> Array:
    """Return when every point first slips faster than a threshold after a time `since` [s], shape (points,).

    Interpolated linearly between records; NaN if never; the time of the first record if it slips from the start.

    Parameters
    ----------
    time : ndarray, shape (times,)
    slip_rate : ndarray, shape (times, points)
    since : float
        [s]
    threshold : float
        [m/s]
    """
    later = np.flatnonzero(time >= since)
    speed = np.abs(slip_rate[later])
    beyond = speed > threshold
    now = beyond.argmax(axis=0) if len(later) else np.zeros(slip_rate.shape[1], dtype=int)
    values = np.full(slip_rate.shape[1], np.nan)
    for point in np.flatnonzero(beyond.any(axis=0)):
        row = now[point]
        values[point] = time[later[row]]
        if row:
            before, after = speed[row - 1, point], speed[row, point]
            part = (after - threshold) / (after - before)
            values[point] -= part * (time[later[row]] - time[later[row - 1]])
    return values
