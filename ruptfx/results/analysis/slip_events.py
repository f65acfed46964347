"""Slip events of a slowly loaded interface: reach, force, front speed and prior stress ratio of each.

Precursors are the events before the first one that spans the whole interface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray

from ruptfx.results.analysis.front import Array, fit_speed, rupture_time

PAUSE = 1e-3  # s; a longer time without sliding separates two events


@dataclass(frozen=True)
class SlipEvent:
    """A period in which part of the interface slides fast.

    Attributes
    ----------
    start : float
        Time of the first record in which it slides [s].
    force, drop : float
        Shear force of the interface before the event, and its decrease [N/m].
    origin, begin, reach : float
        Position of the onset, and the two ends of the sliding part [m].
    arrival : ndarray, shape (points,)
        Onset of sliding at each point [s], NaN if it does not slide.
    before : ndarray, shape (points,)
        Shear over normal stress in the last record before it; NaN without normal stress.
    """

    start: float
    force: float
    drop: float
    origin: float
    begin: float
    reach: float
    arrival: Array
    before: Array


def slip_events(data: xarray.Dataset, threshold: float, pause: float = PAUSE, settling: float = 0.0) -> list[SlipEvent]:
    """Return the events of an interface record in chronological order.

    Parameters
    ----------
    data : Dataset
        `Record.interface`, recorded often enough to resolve events (`interface_steps`).
    threshold : float
        Slip rate above which a point slides [m/s].
    pause : float
        Smallest time without sliding between two events [s].
    settling : float
        Time after an event at which its force drop is measured [s]: while waves last, the shear force of the interface
        is not the force of the load.
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
        after = max(after, min(int(np.searchsorted(time, time[last] + settling)), len(time) - 1))
        force, left = (float(np.trapezoid(shear[record], x)) for record in (before, after))
        normal = data.normal_stress.values[before]
        ratio = np.divide(shear[before], normal, out=np.full(len(x), np.nan), where=normal > 0)
        events.append(SlipEvent(
            float(time[first]), force, force - left, float(x[np.nanargmin(arrival)]), float(x[slid].min()),
            float(x[slid].max()), arrival, ratio,
        ))  # fmt: skip
    return events


def speed_against_ratio(event: SlipEvent, position: Array, width: float, skip: float) -> tuple[Array, Array]:
    """Return front speed and previous shear over normal stress in adjacent windows of an event.

    The windows start at the origin, to both sides. A window is skipped if not all its points slid, if it
    was open somewhere, or if it shows no front.

    Parameters
    ----------
    position : ndarray, shape (points,)
        [m]
    width : float
        Width of a window [m].
    skip : float
        Length of the nucleation zone on each side of the origin, without windows [m].

    Returns
    -------
    ratio, speed : ndarray, shape (windows,)
        Mean of `before` in the window, and the speed away from the origin [m/s].
    """
    items = []
    for sign in (-1, 1):
        away = sign * (position - event.origin)
        for begin in np.arange(skip, away.max(), width):
            inside = (away >= begin) & (away < begin + width)
            if inside.sum() < 4 or not np.isfinite(event.arrival[inside] + event.before[inside]).all():
                continue
            fitted = fit_speed(away[inside], event.arrival[inside]).value
            if fitted > 0:
                items.append((float(np.mean(event.before[inside])), fitted))
    ratio, speed = np.array(items).reshape(-1, 2).T
    return ratio, speed
