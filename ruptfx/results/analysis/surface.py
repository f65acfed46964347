"""Numbers of a rupture on a surface: moment, magnitude, area, rupture speed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table

if TYPE_CHECKING:
    from ruptfx.results.record import Data, Files

TOUCH = 1e-9  # share of a triangle below which a position is on its edge
AT_REST = 0.05  # of the largest moment rate: less at the end is called a rupture that is over
ALIKE = 1e-3  # of the work: difference of the works of two tables whose times are half a step apart
SPENT = ("frictional_dissipation", "fracture", "impact_loss")  # energies that the surface takes
WAVES = ("kinetic", "strain", "damping")
REACH = 4  # nodes to either side over which rupture times are differentiated: about an element


def is_surface(data: Data) -> bool:
    """Return whether the data are of a surface, with two positions of every point."""
    return "dip" in data


def grid(data: Data) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the positions along strike and down dip of a structured surface [m]; None if its points form no grid.

    Points of one column are next to each other, and both arrays have the order of the points, so that values have the
    shape (len(strike), len(dip)). On faults of the Earth a column begins at its lowest point.
    """
    extent = max(np.ptp(data["position"].values), np.ptp(data["dip"].values), 1e-300)
    strike, dip = (np.round(data[name].values / extent, 7) * extent for name in ("position", "dip"))
    columns = len(np.unique(strike))
    if columns * len(np.unique(dip)) != len(strike):
        return None
    strike, dip = strike.reshape(columns, -1), dip.reshape(columns, -1)
    if np.any(strike != strike[:, :1]) or np.any(dip != dip[:1]):
        return None
    return strike[:, 0], dip[0]


class SurfaceInterpolation:
    """Linear interpolation between the points of a surface, on the triangles between them.

    Parameters
    ----------
    data : Data
    strike, dip : ndarray, shape (n,)
        Positions at which values are wanted [m].
    """

    def __init__(self, data: Data, strike: np.ndarray, dip: np.ndarray) -> None:
        points = np.stack([data["position"].values, data["dip"].values], axis=1)
        origin, extent = points.min(axis=0), np.ptp(points, axis=0).max()
        from scipy.spatial import Delaunay  # its import would take longer than the start of a run

        triangles = Delaunay((points - origin) / extent)
        wanted = (np.stack([strike, dip], axis=1) - origin) / extent
        found = triangles.find_simplex(wanted, tol=TOUCH)
        inverse, last = triangles.transform[found, :2], triangles.transform[found, 2]
        first = np.einsum("nij,nj->ni", inverse, wanted - last)
        weights = np.column_stack([first, 1 - first.sum(axis=1)])
        # The value at a point is its own, whatever its neighbours have, which may be NaN.
        self._weights = np.where(np.abs(weights) < TOUCH, 0.0, weights)
        self._points, self._outside = triangles.simplices[found], found < 0

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


def magnitude_of(data: Data, name: str, row: int) -> np.ndarray:
    """Return the length of a tangential field of a surface at a record, shape (points,)."""
    return np.hypot(*(data[f"{name}_{tangent}"].isel(time=row).values for tangent in (1, 2)))


def shear_modulus(data: Data) -> float:
    """Return the mean shear modulus of the bodies, rho c_s^2 [Pa]."""
    return float(np.mean(data.attrs["shear_modulus_of_bodies"]))


def moment_rate(data: Data) -> np.ndarray:
    """Return the moment rate at every record [N m/s]: shear modulus times slip rate, integrated over the surface."""
    area = data["area"].values
    rates = [float(area @ magnitude_of(data, "slip_rate", row)) for row in range(data.sizes["time"])]
    return shear_modulus(data) * np.array(rates)


def moment(data: Data, row: int = -1) -> float:
    """Return the moment at a record [N m]: shear modulus times slip, integrated over the surface."""
    return shear_modulus(data) * float(data["area"].values @ magnitude_of(data, "slip", row))


def moment_magnitude(moment: float) -> float:
    """Return (log10 M_0 - 9.1) / 1.5 of a moment M_0 [N m]; NaN of none (Source: Hanks and Kanamori 1979)."""
    return float((np.log10(moment) - 9.1) / 1.5) if moment > 0 else np.nan


def rupture_velocity(data: Data) -> np.ndarray | None:
    """Return the rupture speed at the points of a structured surface [m/s], shape (strike, dip); None without a grid.

    It is one over the gradient of the rupture time, from differences over `REACH` nodes to either side (less at the
    rim). NaN where the stencil has not ruptured, and where the speed exceeds that of the fastest wave: points that
    start to slip together, as in a nucleation patch, have no front.
    """
    positions = grid(data)
    if positions is None:
        return None
    times = data["rupture_time"].values.reshape(len(positions[0]), len(positions[1]))
    slowness = np.zeros_like(times)
    for axis, x in enumerate(positions):
        last = len(x) - 1
        low, high = np.maximum(np.arange(len(x)) - REACH, 0), np.minimum(np.arange(len(x)) + REACH, last)
        rise = np.take(times, high, axis=axis) - np.take(times, low, axis=axis)
        run = (x[high] - x[low]).reshape((-1, 1) if axis == 0 else (1, -1))
        slowness += (rise / run) ** 2
    with np.errstate(divide="ignore"):
        speed = 1 / np.sqrt(slowness)
    return np.where(speed <= np.max(data.attrs["c_p_of_bodies"]), speed, np.nan)


def work(data: Data, row: int) -> float:
    """Return the work of the tractions of a record on the slip and opening of the last one [J]."""
    shear = sum(data[f"shear_traction_{i}"].values[row] * data[f"slip_{i}"].values[-1] for i in (1, 2))
    return float(data["area"].values @ (shear - data["normal_stress"].values[row] * data["opening"].values[-1]))


def stress_drop(data: Data) -> float:
    """Return the slip-weighted stress drop at the last record [Pa]; NaN without slip.

    It is the work of the fall of the shear traction since the first record on the slip, over the integral of the slip.
    Source: Noda, Lapusta and Kanamori (2013).
    """
    slip = [data[f"slip_{i}"].values[-1] for i in (1, 2)]
    falls = (data[f"shear_traction_{i}"].values[[0, -1]] for i in (1, 2))
    dropped = sum((first - last) * moved for (first, last), moved in zip(falls, slip, strict=True))
    area = data["area"].values
    weight = float(area @ np.hypot(*slip))
    return float(area @ dropped) / weight if weight > 0 else np.nan


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
    found = list(surfaces)
    last = {str(name): float(np.asarray(energy[name])[-1]) for name in energy}
    rates = np.sum([moment_rate(data) for data in found], axis=0)
    first, final = (sum(work(data, row) for data in found) for row in (0, -1))
    known = {*SPENT, *WAVES, "boundary_work", "closure", "time"}
    others = max((abs(value) for name, value in last.items() if name not in known), default=0.0)
    loaded = abs(last["boundary_work"] - first) > ALIKE * abs(first)
    if rates[-1] > AT_REST * rates.max() or loaded or others > ALIKE * abs(first):
        return np.nan
    return 0.5 * (first + final) - sum(last.get(name, 0.0) for name in SPENT)


def of_energies(record: Files) -> Table:
    """Return stress drop and radiated energy of a rupture on surfaces for the summary, where they are defined."""
    if not record.interface.sizes["time"] or not np.size(record.energy["time"]):
        return {}
    energy = np.nan
    if "displacement_jump" not in record.interface:  # springs of contact take energy, too
        energy = radiated_energy(record.interfaces.values(), record.energy)
    return {"stress_drop": stress_drop(record.interface), "radiated_energy": energy}


def of_surface(data: Data) -> Table:
    """Return the scalars of a rupture on a surface for the summary."""
    if not data.sizes["time"]:
        return {}
    area, slip, last = data["area"].values, magnitude_of(data, "slip", -1), moment(data)
    ruptured = np.isfinite(data["rupture_time"].values)
    found: Table = {
        "moment": last,
        "moment_magnitude": moment_magnitude(last),
        "rupture_area": float(area[ruptured].sum()),
        "max_slip": float(slip.max()),
        "peak_slip_rate": float(np.max(data["peak_slip_rate"].values)),
    }
    speed = rupture_velocity(data)
    if speed is not None and np.isfinite(speed).any():
        known, weight = np.isfinite(speed), area.reshape(speed.shape)
        found["rupture_speed"] = float(np.median(speed[known]))
        found["supershear_share"] = float(weight[speed > data.attrs["c_s"]].sum() / weight[known].sum())
    return found
