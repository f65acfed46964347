"""Slip events of an interface, a line or a surface: catalogue, front speed of an event, numbers of a run of many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.input.quantities import with_prefix
from ruptfx.results.analysis.front import rupture_time
from ruptfx.results.analysis.surface import (
    is_surface,
    magnitude_of,
    moment,
    moment_magnitude,
    neighbourhood,
    rupture_velocity,
    tangential,
    wave_speeds,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ruptfx.results.record import Data

DURING = 1e-3  # m/s: an event lasts while the largest slip rate is above
SLID = 0.01  # slip over the largest of an event from which a point belongs to it
HALF = 0.5  # of the area that slid fast: a median of less is not that of its front


@dataclass(frozen=True)
class InterfaceEvent:
    """A period in which some point of an interface slides fast.

    Attributes
    ----------
    first, last : int
        Records before and after the event.
    time, duration : float
        Time of its first fast record, and until the first slow one [s].
    moment : float
        [N m]; NaN of a line.
    magnitude : float
        Moment magnitude; NaN of a line.
    area : float
        Area that slips by a hundredth of the largest slip or more [m2]; of a line its length [m].
    slip, largest_slip : float
        Mean over that area, and largest slip [m].
    stress_drop : float
        Decrease of the shear traction along slip, weighted by slip [Pa].
    centroid : ndarray, shape (2,)
        Position along strike and down dip, weighted by slip [m]; shape (1,) of a line.
    peak_slip_rate : float
        Largest recorded [m/s].
    """

    first: int
    last: int
    time: float
    duration: float
    moment: float
    magnitude: float
    area: float
    slip: float
    largest_slip: float
    stress_drop: float
    centroid: np.ndarray
    peak_slip_rate: float


COLUMNS = {
    "time": "s", "duration": "s", "moment": "N m", "magnitude": "1", "area": "m2", "slip": "m", "largest_slip": "m",
    "stress_drop": "Pa", "strike": "m", "dip": "m", "peak_slip_rate": "m/s",
}  # fmt: skip


def row_of(event: InterfaceEvent) -> dict[str, float]:
    """Return the numbers of an event of a surface by column of a catalogue."""
    places = {"strike": float(event.centroid[0]), "dip": float(event.centroid[1])}
    return {name: places[name] if name in places else getattr(event, name) for name in COLUMNS}


def peak_rates(data: Data) -> np.ndarray:
    """Return the largest slip rate of every record [m/s]."""
    return np.array([magnitude_of(data, "slip_rate", row).max() for row in range(data.sizes["time"])])


def fast_periods(data: Data, peak: np.ndarray, threshold: float = DURING) -> list[tuple[int, int]]:
    """Return the periods of fast slip, as the first fast record and the first slow one after it.

    Two periods with a shorter time between them than a shear wave needs along the interface are one.

    Parameters
    ----------
    peak : ndarray, shape (times,)
        Largest slip rate of every record [m/s].
    threshold : float
        Slip rate above which a point slides fast [m/s].
    """
    time, speeds = data["time"].values, wave_speeds(data)
    pause = (
        float(np.linalg.norm(np.ptp(_positions(data), axis=0))) / float(np.min(speeds["c_s"]))
        if "c_s" in speeds
        else 0.0
    )
    change = np.flatnonzero(np.diff(np.concatenate([[False], peak > threshold, [False]]).astype(int)))
    periods: list[tuple[int, int]] = []
    for begin, end in change.reshape(-1, 2).tolist():
        if periods and time[begin] - time[periods[-1][1]] < pause:
            begin = periods.pop()[0]
        periods.append((begin, end))
    return periods


def interface_events(data: Data, threshold: float = DURING) -> list[InterfaceEvent]:
    """Return the events of the record of an interface in the order of time.

    Events that have begun before the first record or go on after the last one are left out, as their slip is not known.

    Parameters
    ----------
    data : Dataset
        `Record.interface`, with records before and after each event (`output.interface_growth`).
    threshold : float
        Slip rate above which a point slides fast [m/s].
    """
    peak = peak_rates(data)
    return _complete(data, peak, fast_periods(data, peak, threshold))


def _complete(data: Data, peak: np.ndarray, periods: Sequence[tuple[int, int]]) -> list[InterfaceEvent]:
    return [_event(data, peak, begin, end) for begin, end in periods if begin > 0 and end < data.sizes["time"]]


def _event(data: Data, peak: np.ndarray, begin: int, end: int) -> InterfaceEvent:
    first, time = begin - 1, data["time"].values

    def change(name: str) -> np.ndarray:
        return tangential(data, name, end) - tangential(data, name, first)

    vector, area = change("slip"), _areas(data)
    slip = np.linalg.norm(vector, axis=1)
    slid = slip >= SLID * slip.max()
    drop = -np.sum(change("shear_traction") * vector, axis=1)  # times slip
    weight = area * slip
    gained = moment(data, end) - moment(data, first) if is_surface(data) else np.nan
    return InterfaceEvent(
        first, end, float(time[begin]), float(time[end] - time[begin]), gained, moment_magnitude(gained),
        float(area[slid].sum()), float(weight[slid].sum() / area[slid].sum()), float(slip.max()),
        float(np.sum(area * drop) / weight.sum()), weight @ _positions(data) / weight.sum(),
        float(peak[begin:end].max()),
    )  # fmt: skip


def _positions(data: Data) -> np.ndarray:
    return np.stack([data[name].values for name in ("position", "dip") if name in data], axis=1)


def _areas(data: Data) -> np.ndarray:
    """Return the area of every point of a surface [m2], the length of those of a line [m]."""
    if is_surface(data):
        return np.asarray(data["area"].values)
    half = np.abs(np.diff(data["position"].values)) / 2
    return np.append(half, 0.0) + np.append(0.0, half)


def front_speed(data: Data, event: InterfaceEvent) -> tuple[float, str]:
    """Return the median speed of the front of an event [m/s], or NaN and the reason why it has none.

    Arrivals are the rupture times of the steps, where these are of this event. A point has only one: where it slid fast
    in an earlier event, too, arrivals are interpolated between records, and have a speed where the front passes the
    neighbourhood of a point in two records or more.

    Returns
    -------
    speed : float
    reason : str
        Empty with a speed.
    """
    time = data["time"].values[event.first : event.last + 1]
    threshold = float(data.attrs.get("rupture_threshold", DURING))
    rates = [magnitude_of(data, "slip_rate", row) for row in range(event.first, event.last + 1)]
    arrival, apart = rupture_time(np.array(rates), time, threshold), np.zeros(1)
    slid = np.isfinite(arrival)
    of_steps = np.where(slid, data["rupture_time"].values if "rupture_time" in data else np.nan, np.nan)
    if np.all((of_steps >= time[0]) & (of_steps <= time[-1]) | ~slid):
        arrival = of_steps
    else:
        after = np.clip(np.searchsorted(time, np.where(slid, arrival, time[0])), 1, len(time) - 1)
        apart = time[after] - time[after - 1]
    radius, inside = neighbourhood(data, slid)
    speed, area = rupture_velocity(data, arrival)[0], _areas(data)
    known = np.isfinite(speed)
    known &= np.where(known, speed, 0.0) * apart <= radius
    if area[inside].sum() < HALF * area[slid].sum():
        return np.nan, "it is only a few elements wide"
    if area[known].sum() >= HALF * area[slid].sum():
        return float(np.median(speed[known])), ""
    if not apart.any():
        return np.nan, "most of it began to slide at once"
    return np.nan, f"records {with_prefix(float(np.median(apart[slid])), 's')} apart do not resolve it"


def of_events(data: Data, peak: np.ndarray) -> Table:
    """Return the scalars of the events of an interface for the summary; empty where the record has one at most.

    Parameters
    ----------
    peak : ndarray, shape (times,)
        Largest slip rate of every record [m/s].
    """
    periods = fast_periods(data, peak)
    if len(periods) < 2:
        return {}
    events = _complete(data, peak, periods)
    values: Table = {"slip_events": len(periods), "slip_events_complete": len(events)}
    intervals = np.diff(data["time"].values[[begin for begin, _ in periods]])
    values |= {"shortest_event_interval": float(intervals.min()), "longest_event_interval": float(intervals.max())}
    if not events:
        return values
    largest = max(events, key=lambda event: event.moment if is_surface(data) else event.area * event.slip)
    magnitudes = [event.magnitude for event in events]
    speed, reason = front_speed(data, largest)
    return values | {
        "largest_event_time": largest.time,
        "largest_event_magnitude": max(magnitudes),
        "smallest_event_magnitude": min(magnitudes),
        "largest_event_slip": largest.largest_slip,
        "largest_event_stress_drop": largest.stress_drop,
        "largest_event_front_speed": speed,
        "largest_event_front_missing": reason or None,
    }
