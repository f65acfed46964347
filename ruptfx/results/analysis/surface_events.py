"""Catalogue of the earthquakes of a surface over many cycles: time, moment, slip, stress drop, duration, centroid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.results.analysis.surface import magnitude_of, moment, moment_magnitude
from ruptfx.results.record import Data

DURING = 1e-3  # m/s: an event lasts while the largest slip rate is above
SLID = 0.01  # slip over the largest of an event from which a point belongs to it


@dataclass(frozen=True)
class SurfaceEvent:
    """A period in which some point of a surface slides fast.

    Attributes
    ----------
    first, last : int
        Records before and after the event.
    time, duration : float
        Time of its first fast record, and until the first slow one [s].
    moment : float
        [N m]
    magnitude : float
        Moment magnitude.
    area : float
        Area that slips by a hundredth of the largest slip or more [m2].
    slip, largest_slip : float
        Mean over that area, and largest slip [m].
    stress_drop : float
        Decrease of the shear traction along slip, weighted by slip [Pa].
    centroid : ndarray, shape (2,)
        Position along strike and down dip, weighted by slip [m].
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


def row_of(event: SurfaceEvent) -> dict[str, float]:
    """Return the numbers of an event by column of a catalogue."""
    places = {"strike": float(event.centroid[0]), "dip": float(event.centroid[1])}
    return {name: places[name] if name in places else getattr(event, name) for name in COLUMNS}


def peak_rates(data: Data) -> np.ndarray:
    """Return the largest slip rate of every record [m/s]."""
    return np.array([magnitude_of(data, "slip_rate", row).max() for row in range(data.sizes["time"])])


def surface_events(data: Data, threshold: float = DURING) -> list[SurfaceEvent]:
    """Return the events of the record of a surface in the order of time.

    Events that have begun before the first record or go on after the last one are left out, as their slip is not known.

    Parameters
    ----------
    data : Dataset
        `Record.interface` of a surface, with records before and after each event (`output.interface_growth`).
    threshold : float
        Slip rate above which a point slides fast [m/s].
    """
    time, peak = data["time"].values, peak_rates(data)
    change = np.flatnonzero(np.diff(np.concatenate([[False], peak > threshold, [False]]).astype(int)))
    events = []
    for begin, end in change.reshape(-1, 2):
        if begin == 0 or end == len(time):
            continue
        events.append(_event(data, time, peak, int(begin), int(end)))
    return events


def _event(data: Data, time: np.ndarray, peak: np.ndarray, begin: int, end: int) -> SurfaceEvent:
    first = begin - 1

    def change(name: str) -> np.ndarray:
        columns = [data[f"{name}_{tangent}"] for tangent in (1, 2)]
        return np.stack([each.isel(time=end).values - each.isel(time=first).values for each in columns], axis=1)

    vector, area = change("slip"), data["area"].values
    slip = np.linalg.norm(vector, axis=1)
    slid = slip >= SLID * slip.max()
    drop = -np.sum(change("shear_traction") * vector, axis=1)  # times slip
    weight = area * slip
    places = np.stack([data["position"].values, data["dip"].values], axis=1)
    gained = moment(data, end) - moment(data, first)
    return SurfaceEvent(
        first, end, float(time[begin]), float(time[end] - time[begin]), gained, moment_magnitude(gained),
        float(area[slid].sum()), float(weight[slid].sum() / area[slid].sum()), float(slip.max()),
        float(np.sum(area * drop) / weight.sum()), weight @ places / weight.sum(), float(peak[begin:end].max()),
    )  # fmt: skip
