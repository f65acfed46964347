"""Figure of the distances of slip and of pore pressure from a well."""

from __future__ import annotations

import numpy as np

from ruptfx.results.analysis.surface import is_surface
from ruptfx.results.figure_style import Array
from ruptfx.results.plots._record import end_time, slid
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.record import Data, Files

LEVEL = 0.02
"""Of the largest rise of the pressure and of the largest slip in the run, which a point beyond a front has not had."""


def suits(record: Files) -> bool:
    """Return whether the run slipped on an interface whose pore pressure has risen, and not by the heat of friction."""
    if not slid(record) or "frictional_heat" in record.interface:
        return False
    return "pore_pressure" in record.interface and bool(_risen(record.interface).any())


@figure
def fluid_front(sheet: Sheet, record: Files) -> None:
    """Draw how far slip and the rise of the pore pressure have come, from the point of the largest rise.

    A front is the farthest point with 2 % of the largest slip, or of the largest rise of the pressure, of the run until
    then. Slip that is ahead of the fluid is driven by its own stress.
    """
    data = record.interface
    (t_size, t_unit), away = sheet.scale("time", end_time(record), "s"), _away(data)
    fronts = {"Pore pressure": _front(_risen(data), away), "Slip": _front(_slip(data), away)}
    farthest = max(float(np.nanmax(front, initial=0.0)) for front in fronts.values())
    x_size, x_unit = sheet.scale("distance", farthest or float(away.max()), "m")
    ax = sheet.panels(1, 1, 3.2, 4.8)[0, 0]
    for (label, front), style in zip(fronts.items(), ("--", "-"), strict=True):
        ax.plot(data["time"].values / t_size, front / x_size, style, color="#1a1a1a", label=label)
    ax.set(xlabel=f"Time ({t_unit})", ylabel=f"Distance from the well ({x_unit})", ylim=(0, None),
           xlim=(0, end_time(record) / t_size))  # fmt: skip
    ax.legend(loc="best")
    sheet.remark(f"Fronts: {100 * LEVEL:g} % of the largest values of the run.")


def _risen(data: Data) -> Array:
    """Return the rise of the pore pressure since the first record [Pa], shape (times, points)."""
    pressure = data["pore_pressure"].values
    return np.asarray(np.maximum(pressure - pressure[:1], 0.0))


def _slip(data: Data) -> Array:
    """Return the size of the slip [m], shape (times, points)."""
    names = ["slip"] if "slip" in data else ["slip_1", "slip_2"]
    return np.asarray(np.sqrt(sum(data[name].values ** 2 for name in names)))


def _away(data: Data) -> Array:
    """Return the distance from the point of the largest rise of the pressure [m], shape (points,)."""
    places = [data["position"].values, *([data["dip"].values] if is_surface(data) else [])]
    well = int(np.argmax(_risen(data).max(axis=0)))
    return np.asarray(np.sqrt(sum((place - place[well]) ** 2 for place in places)))


def _front(values: Array, away: Array) -> Array:
    """Return the distance of the farthest point that has reached the level [m], shape (times,); NaN before one has."""
    reached = np.maximum.accumulate(values, axis=0) >= LEVEL * max(float(values.max()), np.finfo(float).tiny)
    return np.where(reached.any(axis=1), np.max(np.where(reached, away, 0.0), axis=1), np.nan)
