"""Ramps, knees and drops of the force between two sliding bodies.

A drop, a macro-slip of the interface, is a fall of the force by more than a threshold, from a peak to the trough after
it; a ramp lies between two drops. At a knee the slope of a ramp decreases, because part of the interface has
begun to slide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Drop:
    """A macro-slip: a fall of the force.

    Attributes
    ----------
    start, end : float
        Start and end of the fall [s].
    size : float
        Amount of the fall, in the unit of the force.
    ramp : float
        Duration of the ramp before it, from the previous drop or the start of the record [s].
    """

    start: float
    end: float
    size: float
    ramp: float


@dataclass(frozen=True)
class Knee:
    """Point at which the slope of a ramp decreases.

    Attributes
    ----------
    time : float
        [s]
    before, after : float
        Rates of the force on its two sides [1/s times its unit].
    """

    time: float
    before: float
    after: float


def averaged(time: Array, values: Array, window: float) -> Array:
    """Return the mean over a time window around every record, one-sided at the ends.

    Parameters
    ----------
    time, values : ndarray, shape (times,)
        Increasing times [s], and values that are interpolated linearly.
    window : float
        [s]
    """
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    low, high = (np.clip(time + side * 0.5 * window, time[0], time[-1]) for side in (-1, 1))
    return (_integral_at(high, time, values, integral) - _integral_at(low, time, values, integral)) / (high - low)


def _integral_at(wanted: Array, time: Array, values: Array, integral: Array) -> Array:
    """Return the integral from the first time to each wanted one, exact for linear interpolation."""
    begin = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    after = wanted - time[begin]
    slope = (values[begin + 1] - values[begin]) / (time[begin + 1] - time[begin])
    return integral[begin] + after * (values[begin] + 0.5 * slope * after)


def drops(time: Array, force: Array, least: float, rise: float | None = None) -> list[Drop]:
    """Return the falls of the force that exceed a threshold.

    Parameters
    ----------
    time, force : ndarray, shape (times,)
        Times [s] and the averaged force.
    least : float
        Threshold, in the unit of the force.
    rise : float, optional
        Rise that ends a fall; smaller rises belong to the fall. Default: a fifth of the threshold.
    """
    rise = 0.2 * least if rise is None else rise
    items: list[Drop] = []
    for peak, trough in _falls(force, rise):
        size = float(force[peak] - force[trough])
        if size > least:
            since = items[-1].end if items else float(time[0])
            items.append(Drop(float(time[peak]), float(time[trough]), size, float(time[peak]) - since))
    return items


def _falls(force: Array, reversal: float) -> list[tuple[int, int]]:
    """Return the indices of peaks and following troughs between which the force reverses by more than a threshold."""
    items = []
    peak = trough = 0
    falls = False
    for now in range(len(force)):
        if not falls:
            peak = now if force[now] >= force[peak] else peak
            trough = now
            falls = force[peak] - force[now] > reversal
        elif force[now] < force[trough]:
            trough = now
        elif force[now] - force[trough] > reversal:
            items.append((peak, trough))
            peak, trough, falls = now, now, False
    return [*items, (peak, trough)] if falls else items


def knees(time: Array, force: Array, items: list[Drop], tolerance: float) -> list[Knee]:
    """Return the knees of the ramps: vertices of the polyline that follows the force within a tolerance.

    Parameters
    ----------
    time, force : ndarray, shape (times,)
    tolerance : float
        Largest distance of the polyline, in the unit of the force.

    Notes
    -----
    Source of the polyline: Douglas and Peucker (1973).
    """
    bends = []
    begins = [float(time[0]), *(drop.end for drop in items)]
    ends = [*(drop.start for drop in items), float(time[-1])]
    for begin, end in zip(begins, ends, strict=True):
        ramp = np.flatnonzero((time >= begin) & (time <= end))
        if len(ramp) > 2:
            corner = ramp[_broken_line(time[ramp], force[ramp], tolerance)]
            slopes = np.diff(force[corner]) / np.diff(time[corner])
            bends += [
                Knee(float(time[at]), float(before), float(after))
                for at, before, after in zip(corner[1:-1], slopes[:-1], slopes[1:], strict=True) if after < before
            ]  # fmt: skip
    return bends


def _broken_line(x: Array, y: Array, tolerance: float) -> list[int]:
    """Return the indices of the vertices, including the first and the last point."""
    away = np.abs(y - np.interp(x, x[[0, -1]], y[[0, -1]]))
    farthest = int(np.argmax(away))
    if away[farthest] <= tolerance:
        return [0, len(x) - 1]
    left = _broken_line(x[: farthest + 1], y[: farthest + 1], tolerance)
    right = _broken_line(x[farthest:], y[farthest:], tolerance)
    return [*left, *(farthest + place for place in right[1:])]
