"""Numbers of a rupture on a surface: moment, magnitude, area, rupture speed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx import Table

if TYPE_CHECKING:
    from ruptfx.results.record import Data, Files

TOUCH = 1e-9  # share of a triangle below which a position is on its edge
AT_REST = 0.05  # of the largest moment rate: less at the end is called a rupture that is over
ALIKE = 1e-3  # of the work: difference of the works of two tables whose times are half a step apart
SPENT = ("frictional_dissipation", "fracture", "impact_loss")  # energies that the surface takes
WAVES = ("kinetic", "strain", "damping")
AROUND = 4  # nodes to all sides over which rupture times are differentiated, about an element
NEIGHBOURS = 49  # points of a surface within these
OF_ONE = ("moment_magnitude", "rupture_speed", "supershear_share", "stress_drop")  # numbers of one rupture
BLOCK = 20_000  # points at once, for the memory


def is_surface(data: Data) -> bool:
    """Return whether the data are of a surface, with two positions of every point."""
    return "dip" in data


def grid(data: Data) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the positions along strike and down dip of a structured surface [m]; None if its points form no grid.

    Points of one column are next to each other, up or down dip, and both arrays have the order of the points, so that
    values have the shape (len(strike), len(dip)). On faults of the Earth a column begins at its lowest point.
    """
    extent = max(np.ptp(data["position"].values), np.ptp(data["dip"].values), 1e-300)
    strike, dip = (np.round(data[name].values / extent, 7) * extent for name in ("position", "dip"))
    columns = len(np.unique(strike))
    if columns * len(np.unique(dip)) != len(strike):
        return None
    strike, dip = strike.reshape(columns, -1), dip.reshape(columns, -1)
    if np.any(strike != strike[:, :1]) or np.any(dip != dip[:1]):
        return None
    if any(len(set(np.sign(np.diff(each)))) > 1 for each in (strike[:, 0], dip[0])):
        return None  # points of a column in the order of their heights
    return strike[:, 0], dip[0]


class SurfaceInterpolation:
    """Linear interpolation between the points of a surface, on the triangles between them.

    Parameters
    ----------
    strike, dip : ndarray, shape (n,)
        Positions at which values are wanted [m].
    """

    def __init__(self, data: Data, strike: np.ndarray, dip: np.ndarray) -> None:
        points = np.stack([data["position"].values, data["dip"].values], axis=1)
        origin, extent = points.min(axis=0), np.ptp(points, axis=0).max()
        from scipy.spatial import Delaunay  # its import would take longer than the start of a run

        triangles = Delaunay((points - origin) / extent)
        wanted = (np.stack([strike, dip], axis=1) - origin) / extent
        result = triangles.find_simplex(wanted, tol=TOUCH)
        inverse, last = triangles.transform[result, :2], triangles.transform[result, 2]
        first = np.einsum("nij,nj->ni", inverse, wanted - last)
        weights = np.column_stack([first, 1 - first.sum(axis=1)])
        # The value at a point is its own, whatever its neighbours have, which may be NaN.
        self._weights = np.where(np.abs(weights) < TOUCH, 0.0, weights)
        self._points, self._outside = triangles.simplices[result], result < 0

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return values of a field of the points at the wanted positions, shape (n,); NaN outside of the surface."""
        shares = np.where(self._weights == 0, 0.0, self._weights * values[self._points])
        return np.where(self._outside, np.nan, shares.sum(axis=1))


def rupture_time_difference(one: Data, other: Data) -> tuple[float, float]:
    """Return RMS and largest difference of the rupture times of two surfaces [s]; NaN where no point ruptured in both.

    The mean is over the area of the first surface that ruptured in both runs; times of the second are interpolated.
    """
    times = SurfaceInterpolation(other, one["position"].values, one["dip"].values)(other["rupture_time"].values)
    apart, area = times - one["rupture_time"].values, one["area"].values
    both = np.isfinite(apart)
    if not both.any():
        return np.nan, np.nan
    return float(np.sqrt(np.average(apart[both] ** 2, weights=area[both]))), float(np.abs(apart[both]).max())


def tangential(data: Data, name: str, row: int) -> np.ndarray:
    """Return a tangential field at a record, shape (points, 2); of a line shape (points, 1)."""
    names = [f"{name}_{tangent}" for tangent in (1, 2)] if is_surface(data) else [name]
    return np.stack([data[each].isel(time=row).values for each in names], axis=1)


def magnitude_of(data: Data, name: str, row: int) -> np.ndarray:
    """Return the length of a tangential field at a record of a surface or a line, shape (points,)."""
    columns = tangential(data, name, row).T
    return np.hypot(*columns) if len(columns) == 2 else np.abs(columns[0])


def all_surfaces(record: Files) -> bool:
    """Return whether the run has interfaces, and all of them are surfaces."""
    return bool(record.interfaces) and all(map(is_surface, record.interfaces.values()))


def wave_speeds(data: Data) -> dict[str, Any]:
    """Return c_R, c_s, c_p and the fastest wave along an interface [m/s], each of shape (points,) or a number.

    They are those beside every point: c_R, c_s and c_p of the side with the slower shear waves. Runs of earlier
    versions have one number, of the body with the slowest shear waves.
    """
    if "fastest_wave" in data:
        names = {"c_R": "c_R", "c_s": "c_s", "c_p": "c_p", "fastest": "fastest_wave"}
        return {name: np.asarray(data[column].values) for name, column in names.items()}
    entries = {name: float(data.attrs[name]) for name in ("c_R", "c_s", "c_p") if name in data.attrs}
    fastest = data.attrs.get("c_p_of_bodies", entries.get("c_p"))
    return entries if fastest is None else entries | {"fastest": float(np.max(fastest))}


def _times_modulus(data: Data, name: str, row: int, part: np.ndarray | float = 1.0) -> float:
    """Return the shear modulus along a tangential field times its length, integrated over a part of a surface.

    Beside two bodies the modulus is the harmonic mean of both: slip then has the moment that it has in a uniform body
    in which the same stress drop causes it (Source: Wu and Chen 2003). Runs of earlier versions have the mean over all
    bodies.
    """
    area, length = part * data["area"].values, magnitude_of(data, name, row)
    if "shear_modulus_11" not in data:
        return float(np.mean(data.attrs["shear_modulus_of_bodies"])) * float(area @ length)
    along, across = (data[f"{name}_{tangent}"].isel(time=row).values for tangent in (1, 2))
    G_11, G_22, G_12 = (data[f"shear_modulus_{index}"].values for index in ("11", "22", "12"))
    energy = G_11 * along**2 + 2 * G_12 * along * across + G_22 * across**2
    return float(area @ (energy / np.where(length > 0, length, 1.0)))


def moment_rate(data: Data, part: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the moment rate at every record [N m/s]: shear modulus times slip rate, integrated over the surface.

    Parameters
    ----------
    part : ndarray, shape (points,)
        Share of the area of every point that counts.
    """
    return np.array([_times_modulus(data, "slip_rate", row, part) for row in range(data.sizes["time"])])


def moment(data: Data, row: int = -1) -> float:
    """Return the moment at a record [N m]: shear modulus times slip, integrated over the surface."""
    return _times_modulus(data, "slip", row)


def moment_magnitude(moment: float) -> float:
    """Return (log10 M_0 - 9.1) / 1.5 of a moment M_0 [N m]; NaN of none (Source: Hanks and Kanamori 1979)."""
    return float((np.log10(moment) - 9.1) / 1.5) if moment > 0 else np.nan


def rupture_velocity(data: Data, times: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the rupture speed at the points of a surface or line, and the shear wave speed in its direction [m/s].

    It is one over the gradient of the rupture time in the plane of the points around each: that of the linear function
    with the least squares of differences at the `NEIGHBOURS` nearest points, whose weights fall to zero with the
    distance. NaN where one of these has not ruptured, and where the speed exceeds that of the fastest wave beside the
    point: points that start to slip together, as in a nucleation patch, have no front.

    Parameters
    ----------
    times : ndarray, shape (points,)
        Of arrival [s], NaN where there is none; default: the rupture time.

    Returns
    -------
    tuple of ndarray, shapes (points,)
    """
    times, strike = data["rupture_time"].values if times is None else times, data["position"].values
    speeds = wave_speeds(data)
    gradients = _gradients(_points(data), np.stack([times, strike], axis=1))
    slowness = np.linalg.norm(gradients[:, 0], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = 1 / slowness
        # The gradient of the position is the direction of strike in the surface.
        cosine = np.sum(gradients[:, 0] * gradients[:, 1], axis=1) / slowness
    shear = np.broadcast_to(speeds["c_s"], speed.shape)
    if "c_s_dip" in data:
        part = np.clip(cosine / np.linalg.norm(gradients[:, 1], axis=1), -1, 1) ** 2
        shear = np.sqrt(part * shear**2 + (1 - part) * data["c_s_dip"].values ** 2)
    return np.where(speed <= speeds["fastest"], speed, np.nan), shear


def _points(data: Data) -> np.ndarray:
    """Return the points of a surface [m], in the plane of their positions where they have no coordinates; of a line."""
    names = [axis for axis in "xyz" if axis in data]
    in_plane = [name for name in ("position", "dip") if name in data]
    return np.stack(
        [data[name].values for name in (names if is_surface(data) and len(names) == 3 else in_plane)], axis=1
    )


def _neighbours(dimension: int) -> int:
    """Return the number of points over which rupture times are differentiated."""
    return NEIGHBOURS if dimension > 1 else 2 * AROUND + 1


def neighbourhood(data: Data, arrived: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the radius in which `rupture_velocity` differentiates times [m], and whether all points within arrived.

    Parameters
    ----------
    arrived : ndarray of bool, shape (points,)
    """
    from scipy.spatial import KDTree  # its import would take longer than the start of a run

    points = _points(data)
    distance, near = KDTree(points).query(points, k=min(_neighbours(points.shape[1]), len(points)))
    radius = distance[:, -1]
    return radius, np.all(arrived[near] | (distance >= radius[:, None] * (1 - TOUCH)), axis=1)


def _gradients(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return gradients in a surface, shape (points, values, axes), as `rupture_velocity` describes.

    Parameters
    ----------
    points : ndarray, shape (n, axes)
        [m].
    values : ndarray, shape (n, values)
    """
    from scipy.spatial import KDTree  # its import would take longer than the start of a run

    result, tree = [], KDTree(points)
    for begin in range(0, len(points), BLOCK):
        centre = points[begin : begin + BLOCK]
        distance, near = tree.query(centre, k=min(_neighbours(points.shape[1]), len(points)))
        # Points at the largest distance have no weight: which of several equally far ones these are does not matter.
        weight = np.maximum(1 - (distance / distance[:, -1:]) ** 2, 0.0) ** 2
        weight[weight < TOUCH] = 0.0
        away = points[near] - centre[:, None]
        away -= np.sum(weight[..., None] * away, axis=1, keepdims=True) / weight.sum(axis=1)[:, None, None]
        moments = np.einsum("nk,nki,nkj->nij", weight, away, away)
        size, axes = np.linalg.eigh(moments)
        size, axes = size[:, -2:], axes[:, :, -2:]  # those of the surface, without its normal
        differences = np.where(weight[..., None] > 0, values[near] - values[begin : begin + BLOCK][:, None], 0.0)
        slopes = np.einsum("nk,nki,nia,nkv->nva", weight, away, axes, differences, optimize=True)
        result.append(np.einsum("nva,nia->nvi", slopes / np.maximum(size, 1e-300)[:, None], axes))
    return np.concatenate(result)


def work(data: Data, row: int) -> float:
    """Return the work of the tractions of a record on the slip and opening of the last one [J]."""
    shear = sum(data[f"shear_traction_{i}"].values[row] * data[f"slip_{i}"].values[-1] for i in (1, 2))
    return float(data["area"].values @ (shear - data["normal_stress"].values[row] * data["opening"].values[-1]))


def stress_drop(*surfaces: Data) -> float:
    """Return the slip-weighted stress drop of surfaces at the last record [Pa]; NaN without slip.

    It is the work of the fall of the shear traction on the slip, over the integral of the slip. The traction falls from
    that of the first record and what nucleations have added since; runs of earlier versions do not have the latter.
    Source: Noda, Lapusta and Kanamori (2013).
    """
    fallen = weight = 0.0
    for data in surfaces:
        slip = [data[f"slip_{i}"].values[-1] for i in (1, 2)]
        falls = [data[f"shear_traction_{i}"].values[0] - data[f"shear_traction_{i}"].values[-1] for i in (1, 2)]
        if "added_shear_1" in data:
            falls = [fall + data[f"added_shear_{i}"].values for i, fall in enumerate(falls, 1)]
        dropped = sum(fall * moved for fall, moved in zip(falls, slip, strict=True))
        area = data["area"].values
        fallen, weight = fallen + float(area @ dropped), weight + float(area @ np.hypot(*slip))
    return fallen / weight if weight > 0 else np.nan


def radiated_energy(surfaces: Iterable[Data], energy: Mapping[str, object] | Data) -> float:
    """Return the energy that a rupture radiates from its surfaces [J]; NaN where the records do not give it.

    It is the mean of the works of the initial and of the final tractions on the slip, less what friction and cohesion
    take. Source: Kostrov (1974); Rivera and Kanamori (2005).

    The final tractions are those of the last record: the energy is NaN unless the moment rate is then below 5 % of its
    largest value. It is also NaN where loads other than the initial stress of the surfaces do work, and where springs
    of contact, attachments or bodies that yield take energy.

    Parameters
    ----------
    surfaces : iterable of Data
        All surfaces of the run.
    energy : mapping of arrays, shape (times,)
        The columns of its energy table.
    """
    items = list(surfaces)
    last = {str(name): float(np.asarray(energy[name])[-1]) for name in energy}
    rates = np.sum([moment_rate(data) for data in items], axis=0)
    first, final = (sum(work(data, row) for data in items) for row in (0, -1))
    known = {*SPENT, *WAVES, "boundary_work", "closure", "time"}
    others = max((abs(value) for name, value in last.items() if name not in known), default=0.0)
    loaded = abs(last["boundary_work"] - first) > ALIKE * abs(first)
    if rates[-1] > AT_REST * rates.max() or loaded or others > ALIKE * abs(first):
        return np.nan
    return 0.5 * (first + final) - sum(last.get(name, 0.0) for name in SPENT)


def radiated_energy_of(record: Files) -> float:
    """Return the energy radiated by all surfaces of a run [J]; NaN where it is not defined."""
    surfaces = record.interfaces.values()
    recorded = all(data.sizes["time"] for data in surfaces) and np.size(record.energy["time"])
    # Springs of contact take energy, too.
    springs = any("displacement_jump" in data for data in surfaces)
    return radiated_energy(surfaces, record.energy) if recorded and not springs else np.nan


def of_surface(data: Data, several: bool = False) -> Table:
    """Return the scalars of a rupture on a surface for the summary.

    Parameters
    ----------
    several : bool
        Whether the record has several slip events; magnitude, front speed and stress drop are of one, hence NaN.
    """
    if not data.sizes["time"]:
        return {}
    area, slip, last = data["area"].values, magnitude_of(data, "slip", -1), moment(data)
    ruptured = np.isfinite(data["rupture_time"].values)
    values = {
        "moment": last,
        "rupture_area": float(area[ruptured].sum()),
        "max_slip": float(slip.max()),
        "peak_slip_rate": float(np.max(data["peak_slip_rate"].values)),
    }
    return values | (dict.fromkeys(OF_ONE, np.nan) if several else _of_rupture(data, area, last))


def _of_rupture(data: Data, area: np.ndarray, last: float) -> Table:
    speed, shear = rupture_velocity(data)
    front = np.isfinite(speed)
    return {
        "moment_magnitude": moment_magnitude(last),
        "rupture_speed": float(np.median(speed[front])) if front.any() else np.nan,
        "supershear_share": float(area[front & (speed > shear)].sum() / area[front].sum()) if front.any() else np.nan,
        "stress_drop": stress_drop(data),
    }


def of_surfaces(record: Files, each: list[Table]) -> Table:
    """Return the scalars of all surfaces of a run together, from those of each.

    Magnitude and stress drop are of one rupture, and NaN where a surface has several slip events.
    """
    if any("moment" not in item for item in each):
        return {}
    total, several = sum(item["moment"] for item in each), any("slip_events" in item for item in each)
    return {
        "moment": total, "moment_magnitude": np.nan if several else moment_magnitude(total),
        "rupture_area": sum(item["rupture_area"] for item in each),
        "stress_drop": np.nan if several else stress_drop(*record.interfaces.values()),
    }  # fmt: skip
