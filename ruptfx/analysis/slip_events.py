"""Slip events of an interface that is loaded slowly: how far each runs, at which force, how fast, into which stress.

Precursors are the events before the first that slides through the whole interface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray

from ruptfx.analysis.front import Array, fit_speed, rupture_time

PAUSE = 1e-3  # s; what is calm for longer lies between two events


@dataclass(frozen=True)
class SlipEvent:
    """One time that a part of the interface slides fast.

    Attributes
    ----------
    start : float
        Time of the first record in which it slides [s].
    force, drop : float
        Shear force of the interface before it, and by how much that is less after it [N/m].
    origin, begin, reach : float
        Where it starts, and the ends of what slides [m].
    arrival : ndarray, shape (points,)
        When each point starts to slide [s], NaN where it does not.
    before : ndarray, shape (points,)
        Shear over normal stress in the last record before it; NaN where nothing presses.
    """

    start: float
    force: float
    drop: float
    origin: float
    begin: float
    reach: float
    arrival: Array
    before: Array


def slip_events(data: xarray.Dataset, threshold: float, pause: float = PAUSE) -> list[SlipEvent]:
    """Events of a record of an interface, in the order of time.

    Parameters
    ----------
    data : Dataset
        `Record.interface`, with records as often as things happen (`interface_steps`).
    threshold : float
        Slip rate above which a point slides [m/s].
    pause : float
        Two events are calm for so long between them [s].
    """
    time, x = data.time.values, data.position.values
    rate = np.abs(data.slip_rate.values)
    fast = np.flatnonzero(rate.max(axis=1) > threshold)
    if not len(fast):
        return []
    ends = np.flatnonzero(np.diff(time[fast]) > pause)
    events = []
    for first, last in zip(fast[np.append(0, ends + 1)], fast[np.append(ends, len(fast) - 1)], strict=True):
        before, after = max(first - 1, 0), min(last + 1, len(time) - 1)
        arrival = rupture_time(rate[before : after + 1], time[before : after + 1], threshold)
        slid, shear = np.isfinite(arrival), data.shear_traction.values
        force, left = (float(np.trapezoid(shear[record], x)) for record in (before, after))
        normal = data.normal_stress.values[before]
        ratio = np.divide(shear[before], normal, out=np.full(len(x), np.nan), where=normal > 0)
        events.append(SlipEvent(
            float(time[first]), force, force - left, float(x[np.nanargmin(arrival)]), float(x[slid].min()),
            float(x[slid].max()), arrival, ratio,
        ))  # fmt: skip
    return events


def speed_against_ratio(event: SlipEvent, position: Array, width: float, skip: float) -> tuple[Array, Array]:
    """Speed of the fronts of an event, and the shear over normal stress they ran into, in windows side by side.

    The windows go out from the origin to both sides. Left out is a window that did not slide at all of its points, that
    was open somewhere, or through which no front can be told.

    Parameters
    ----------
    event : SlipEvent
    position : ndarray, shape (points,)
        [m]
    width : float
        Of a window [m].
    skip : float
        Where the event nucleates, on each side of the origin [m]: no windows there.

    Returns
    -------
    ratio, speed : ndarray, shape (windows,)
        Mean of `before` in the window, and the speed away from the origin [m/s].
    """
    found = []
    for sign in (-1, 1):
        away = sign * (position - event.origin)
        for begin in np.arange(skip, away.max(), width):
            inside = (away >= begin) & (away < begin + width)
            if inside.sum() < 4 or not np.isfinite(event.arrival[inside] + event.before[inside]).all():
                continue
            fitted = fit_speed(away[inside], event.arrival[inside]).value
            if fitted > 0:
                found.append((float(np.mean(event.before[inside])), fitted))
    ratio, speed = np.array(found).reshape(-1, 2).T
    return ratio, speed
