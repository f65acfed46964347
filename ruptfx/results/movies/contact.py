"""Contact on the surface of a sliding interface between solids: pressure, slip and the real area of contact."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ruptfx import RuptfxError
from ruptfx.results.analysis.real_contact import contact_area, contact_box, touching
from ruptfx.results.analysis.surface import SurfaceInterpolation
from ruptfx.results.figure_style import RATE_MAP, Array, scale
from ruptfx.results.movies import Film
from ruptfx.results.plots import surface_maps as _surface
from ruptfx.results.plots.contact_maps import ARROW, ARROWS, area_scale, slip_of_contact, suits, thinned
from ruptfx.results.record import Data, Record

PIXELS = 500  # along the longer extent
LONGEST = 1.3  # squares of the grid of arrows that the longest arrow spans


def contact(record: Record) -> Film:
    """Return the film of the contact pressure on `record.interface`, with arrows of the slip.

    Points are at their initial positions on the plus side; places that do not touch have no colour. Below the picture
    is the real area of contact over time.

    Raises
    ------
    RuptfxError
        The interface is no surface with finite sliding, or it never touches.
    """
    if not suits(record):
        raise RuptfxError(
            f"{record.path}: contact is drawn on surfaces of solids with finite sliding, at saved times; take --what "
            "slip_rate"
        )
    data = record.interface
    time, closed = data["time"].values, touching(data)
    if not closed.any():
        raise RuptfxError(f"{record.path}: no point touches at {len(time)} records; take --what slip_rate")
    pressure = np.where(closed, data["normal_stress"].values, 0.0)
    (left, right), (top, bottom) = box = contact_box(data)
    size, unit = scale(pressure.max(), "Pa")
    lengths = scale(float(np.ptp(box, axis=1).max()), "m")
    pixel = max(right - left, bottom - top) / PIXELS
    x, y = (np.linspace(*ends, max(2, round(abs(np.ptp(ends)) / pixel))) for ends in ((left, right), (bottom, top)))
    at_pixels = SurfaceInterpolation(data, *(each.ravel() for each in np.meshgrid(x, y)))

    def image(row: int) -> Array:
        shown = np.where(at_pixels(1.0 * closed[row]) >= 0.5, at_pixels(pressure[row] / size), np.nan)
        return np.asarray(shown.reshape(len(y), len(x)))

    largest = float(np.max([np.linalg.norm(slip_of_contact(data, row), axis=1).max() for row in range(len(time))]))
    slip_size, slip_unit = scale(largest, "m")

    def move(axes: Axes, row: int) -> None:
        for drawn in list(axes.collections):
            drawn.remove()
        slip = slip_of_contact(data, row)
        points = thinned(data, np.linalg.norm(slip, axis=1) > 0.02 * largest, box)
        strike, dip = (data[name].values[points] / lengths[0] for name in ("position", "dip"))
        axes.quiver(
            strike, dip, *slip[points].T, angles="xy", scale=largest * ARROWS / LONGEST, color=ARROW, width=3e-3
        )

    along, across = _surface.axis_names(data, lengths)
    extent = left / lengths[0], right / lengths[0], bottom / lengths[0], top / lengths[0]
    look: dict[str, Any] = {"cmap": RATE_MAP, "vmin": 0.0, "vmax": float(pressure.max()) / size or 1.0}
    return Film(
        time, image, extent, along, across, f"Pressure ({unit})", look, move=move,
        remark=f"Arrows: slip, the longest {largest / slip_size:.3g} {slip_unit}." if largest else "",
        below=partial(_area, data),
    )  # fmt: skip


def _area(data: Data, axes: Axes) -> Callable[[float], None]:
    """Draw the real area of contact over time, and return the function that marks a time [s]."""
    time, area = data["time"].values, contact_area(data)
    (t_size, t_unit), (size, unit) = scale(time, "s"), area_scale(float(area.max()))
    axes.plot(time / t_size, area / size, color="#c1440e")
    (mark,) = axes.plot([], [], "o", color="#1a1a1a", ms=4, clip_on=False)
    axes.set(xlabel=f"Time ({t_unit})", ylabel=f"Real area ({unit})", ylim=(0, 1.05 * area.max() / size))
    axes.set_xlim(time[0] / t_size, max(time[-1], time[0] + 1e-300) / t_size)

    def show(now: float) -> None:
        mark.set_data([now / t_size], [np.interp(now, time, area) / size])

    return show
