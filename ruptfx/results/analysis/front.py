"""Rupture fronts: onset of sliding at each point, position of the tip, and front speeds.

Distances are measured along the interface from where the rupture starts, in increasing order. All functions
take plain arrays: slip rate against time and distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
TIE = 1e-6  # of a length: points that near to the end of a window are inside, whatever the rounding of positions


@dataclass(frozen=True)
class Speed:
    """A front speed from a straight line through (distance, arrival time).

    Attributes
    ----------
    value, error : float
        Speed and its standard error [m/s]; NaN where fewer than four points could be used or where the
        slope is not three times its standard error.
    start, stop : float
        Distances between which it was fitted [m].
    points : int
        Points kept by the fit.
    """

    value: float = np.nan
    error: float = np.nan
    start: float = np.nan
    stop: float = np.nan
    points: int = 0


@dataclass(frozen=True)
class Front:
    """Arrival time [s] of one front at successive distances [m], both of shape (points,)."""

    distance: Array
    time: Array


def crossing(low: Array, high: Array, threshold: float) -> Array:
    """Return the fraction [1] of the interval between two rates [m/s] at which a threshold is passed, point by point.

    Interpolated in the logarithm of the rate, the lower one being at least threshold^2 / high: exact for
    exponential tails, and half-way for the sudden start of a point that was stuck, which linear interpolation
    would always put next to the stuck sample.
    """
    bottom = np.clip(low, threshold**2 / high, threshold)
    return np.log(threshold / bottom) / np.log(high / bottom)


def onsets(slip_rate: Array, time: Array, threshold: float) -> tuple[Array, Array]:
    """Return every onset of sliding: upward passages of the slip rate through the threshold.

    The time is interpolated between the two saved times around the crossing (`crossing`). A point that slides
    from the first saved time on starts there.

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
        Slip rate [m/s], of either sign.
    time : ndarray, shape (times,)
        Saved times [s].
    threshold : float
        Slip rate [m/s] above which a point slides.

    Returns
    -------
    column, when : ndarray, shape (events,)
        Index of the point, and time [s], sorted by point and then by time.
    """
    rate = np.abs(slip_rate)
    slides = rate > threshold
    starts = slides & ~np.vstack([np.zeros_like(slides[:1]), slides[:-1]])
    column, row = np.nonzero(starts.T)
    before = np.maximum(row - 1, 0)
    part = crossing(rate[before, column], rate[row, column], threshold)
    return column, time[before] + np.where(row > 0, part, 0.0) * (time[row] - time[before])


def rupture_time(slip_rate: Array, time: Array, threshold: float) -> Array:
    """Return the first time at which each point slides [s], NaN if never; shape (points,).

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
    time : ndarray, shape (times,)
    threshold : float
        Slip rate [m/s] above which a point slides.
    """
    column, when = onsets(slip_rate, time, threshold)
    first = np.full(slip_rate.shape[1], np.nan)
    points, index = np.unique(column, return_index=True)
    first[points] = when[index]
    return first


def tip_position(rupture_time: Array, distance: Array, time: Array) -> Array:
    """Return the position of the leading tip at given times [m], NaN before rupture; shape (times,).

    The tip runs through the points of increasing distance up to the first that never slid, so that it lies
    between the start and that point. Between two points it is interpolated linearly in time.

    Parameters
    ----------
    rupture_time, distance : ndarray, shape (points,)
        First time of sliding [s] (NaN if never) and distance [m].
    time : ndarray, shape (times,)
        Times at which to evaluate [s].
    """
    slid = np.isfinite(rupture_time)
    stop = len(slid) if slid.all() else int(slid.argmin())
    if stop == 0:
        return np.full(len(time), np.nan)
    # A point that slid before its predecessors has moved the tip ahead: arrival = earliest time at or beyond
    # it.
    arrival = np.minimum.accumulate(rupture_time[:stop][::-1])[::-1]
    return np.interp(time, arrival, distance[:stop], left=np.nan)


def fit_speed(
    distance: Array,
    arrival: Array,
    start: float | None = None,
    stop: float | None = None,
    outlier: float = 3.0,
) -> Speed:
    """Fit a front speed by least squares of arrival time against distance, with rejection of outliers.

    t = t_0 + x/v is linear in 1/v, and the noise of sampling is in t. Points further than `outlier` robust
    standard deviations (1.4826 times the median absolute residual) from the line are dropped and the line
    fitted again.

    Parameters
    ----------
    distance, arrival : ndarray, shape (points,)
        Distance [m] and arrival time [s]; NaN times are ignored.
    start, stop : float, optional
        Distances [m] between which to fit, default all.
    outlier : float
        Rejection limit in standard deviations.
    """
    lower, upper = -np.inf if start is None else start, np.inf if stop is None else stop
    slack = TIE * np.ptp(distance) if len(distance) else 0.0
    inside = np.isfinite(arrival) & (distance >= lower - slack) & (distance <= upper + slack)
    x, t = distance[inside], arrival[inside]
    if len(x) < 4 or np.ptp(x) == 0:
        return Speed(points=len(x))
    keep = np.ones(len(x), dtype=bool)
    for _ in range(20):
        centre = x[keep].mean()
        slowness = np.sum((x[keep] - centre) * t[keep]) / np.sum((x[keep] - centre) ** 2)
        residual = t - t[keep].mean() - slowness * (x - centre)
        spread = 1.4826 * np.median(np.abs(residual[keep]))
        kept = np.abs(residual) <= max(outlier * spread, 1e-12 * np.abs(t).max())
        if np.array_equal(kept, keep) or kept.sum() < 4 or np.ptp(x[kept]) == 0:
            break
        keep = kept
    variance = np.sum(residual[keep] ** 2) / max(keep.sum() - 2, 1)
    deviation = np.sqrt(variance / np.sum((x[keep] - centre) ** 2))
    # Points that all start together, or in no order, have no front speed.
    if abs(slowness) <= max(3 * deviation, 1e-9 * np.abs(t).max() / np.ptp(x)):
        return Speed(points=int(keep.sum()))
    ends = float(x[keep].min()), float(x[keep].max())
    return Speed(float(1 / slowness), float(deviation / slowness**2), *ends, int(keep.sum()))


def local_speed(distance: Array, arrival: Array, width: float) -> Array:
    """Return the front speed along the interface, by a least-squares line in a moving window.

    Parameters
    ----------
    distance, arrival : ndarray, shape (points,)
        Distance [m], increasing, and arrival time [s], NaN where the front never came.
    width : float
        Width of the window [m].

    Returns
    -------
    ndarray, shape (points,)
        Speed [m/s]; NaN where fewer than four points of the window ruptured.
    """
    good = np.isfinite(arrival)
    t = np.where(good, arrival, 0.0)
    first = np.searchsorted(distance, distance - width / 2, side="left")
    last = np.searchsorted(distance, distance + width / 2, side="right")

    def within(values: Array) -> Array:
        total = np.append(0.0, np.cumsum(values * good))
        return total[last] - total[first]

    # Centred sums, so that the differences of cumulative sums keep their digits.
    x, t = distance - distance.mean(), t - (t[good].mean() if good.any() else 0.0)
    count = within(np.ones_like(x))
    with np.errstate(divide="ignore", invalid="ignore"):
        covariance = within(x * t) - within(x) * within(t) / count
        variance = within(x * x) - within(x) ** 2 / count
        speed = variance / covariance
    return np.where(good & (count >= 4), speed, np.nan)


def trace_fronts(
    slip_rate: Array, time: Array, distance: Array, threshold: float, slowest: float, min_length: float = 0.0
) -> list[Front]:
    """Follow every front from point to point: the leading tip and the pulses behind it.

    Starts of sliding at neighbouring points belong to the same front if each is the other's nearest in time
    and they are no further apart than a front of speed `slowest` and two saved times allow.

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
        Slip rate [m/s].
    time, distance : ndarray, shapes (times,) and (points,)
        Saved times [s] and increasing distances [m].
    threshold : float
        Slip rate [m/s] above which a point slides.
    slowest : float
        Slowest front to follow [m/s].
    min_length : float
        Shorter fronts [m] are left out.

    Returns
    -------
    list of Front
        In the order in which they passed their points.
    """
    column, when = onsets(slip_rate, time, threshold)
    if len(column) < 2 or len(time) < 2:
        return []
    ahead, behind = _nearest(column, when, +1), _nearest(column, when, -1)
    event = np.arange(len(column))
    linked = (ahead >= 0) & (behind[ahead] == event)
    spacing = distance[column[ahead]] - distance[column]
    linked &= np.abs(when[ahead] - when) <= spacing / slowest + 2 * np.diff(time).max()
    label = _first_of_chains(event[linked], ahead[linked], len(event))
    order = np.lexsort((column, label))
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    fronts = [Front(distance[column[group]], when[group]) for group in groups]
    fronts = [front for front in fronts if np.ptp(front.distance) >= min_length and len(front.time) >= 4]
    # At equal distance the earlier front leads: sort by retarded time at the fastest front's speed.
    return sorted(fronts, key=lambda front: float(np.median(front.time - front.distance / _fastest(fronts))))


def _first_of_chains(event: Array, following: Array, count: int) -> Array:
    """Return the first event of the chain of each event; each link leads from `event` to `following`.

    No event has two links ahead or two behind.
    """
    first = np.arange(count)
    first[following] = event
    while np.any(first[first] != first):  # pointer jumping doubles the distance in every pass
        first = first[first]
    return first


def _fastest(fronts: list[Front]) -> float:
    speeds = np.array([fit_speed(front.distance, front.time).value for front in fronts])
    speeds = speeds[np.isfinite(speeds) & (speeds > 0)]
    return float(np.median(speeds)) if len(speeds) else np.inf


def _nearest(column: Array, when: Array, step: int) -> Array:
    """Return for each event the nearest one in time at the neighbouring point, -1 if that has none."""
    # One sorted key for all points: point number times a span longer than twice the record, plus time.
    span = 3 * (np.ptp(when) + np.finfo(float).tiny) + 1e-30
    key = column * span + (when - when.min())
    target = key + step * span
    right = np.clip(np.searchsorted(key, target), 1, len(key) - 1)
    best = np.where(np.abs(key[right] - target) < np.abs(key[right - 1] - target), right, right - 1)
    return np.where(column[best] == column + step, best, -1)
