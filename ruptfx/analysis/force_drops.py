"""Ramps, knees and drops of the force between two bodies that slide.

A drop, a macro-slip of the interface, is a fall of the force by more than a threshold, from a peak to the trough after
it; a ramp is what is between two of them. At a knee a ramp goes on less steeply, because part of the interface has
begun to slide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Drop:
    """A macro-slip.

    Attributes
    ----------
    start, end : float
        Of the fall [s].
    size : float
        By how much the force falls.
    ramp : float
        How long the force had risen before, since the drop before or since the record began [s].
    """

    start: float
    end: float
    size: float
    ramp: float


@dataclass(frozen=True)
class Knee:
    """Where a ramp bends down.

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
    """Mean over a window of time around every record, which is one-sided at the ends.

    Parameters
    ----------
    time, values : ndarray, shape (times,)
        Increasing times [s], and what is linear between them.
    window : float
        [s]
    """
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    low, high = (np.clip(time + side * 0.5 * window, time[0], time[-1]) for side in (-1, 1))
    return (_integral_at(high, time, values, integral) - _integral_at(low, time, values, integral)) / (high - low)


def _integral_at(wanted: Array, time: Array, values: Array, integral: Array) -> Array:
    """Since the first time, exactly for values that are linear between records."""
    begin = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    after = wanted - time[begin]
    slope = (values[begin + 1] - values[begin]) / (time[begin + 1] - time[begin])
    return integral[begin] + after * (values[begin] + 0.5 * slope * after)


def drops(time: Array, force: Array, least: float, rise: float | None = None) -> list[Drop]:
    """Falls of the force by more than a threshold.

    Parameters
    ----------
    time, force : ndarray, shape (times,)
        The latter averaged over what is not to be seen.
    least : float
        Threshold, in the unit of the force.
    rise : float, optional
        What ends a fall; smaller rises within one belong to it. Default: a fifth of the threshold.
    """
    rise = 0.2 * least if rise is None else rise
    found: list[Drop] = []
    for peak, trough in _falls(force, rise):
        size = float(force[peak] - force[trough])
        if size > least:
            since = found[-1].end if found else float(time[0])
            found.append(Drop(float(time[peak]), float(time[trough]), size, float(time[peak]) - since))
    return found


def _falls(force: Array, reversal: float) -> list[tuple[int, int]]:
    """Places of peaks and of the troughs after them, between which the force turns by more than a threshold."""
    found = []
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
            found.append((peak, trough))
            peak, trough, falls = now, now, False
    return [*found, (peak, trough)] if falls else found


def knees(time: Array, force: Array, found: list[Drop], tolerance: float) -> list[Knee]:
    """Where the ramps between drops bend down: vertices of the broken line that stays within a tolerance of the force.

    Parameters
    ----------
    time, force : ndarray, shape (times,)
    found : list of Drop
    tolerance : float
        Largest distance of the broken line, in the unit of the force.

    Notes
    -----
    Source of the broken line: Douglas and Peucker (1973).
    """
    bends = []
    begins = [float(time[0]), *(drop.end for drop in found)]
    ends = [*(drop.start for drop in found), float(time[-1])]
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
    """Places of the vertices, the first and the last among them."""
    away = np.abs(y - np.interp(x, x[[0, -1]], y[[0, -1]]))
    farthest = int(np.argmax(away))
    if away[farthest] <= tolerance:
        return [0, len(x) - 1]
    left = _broken_line(x[: farthest + 1], y[: farthest + 1], tolerance)
    right = _broken_line(x[farthest:], y[farthest:], tolerance)
    return [*left, *(farthest + place for place in right[1:])]
