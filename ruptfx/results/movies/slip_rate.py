"""Slip rate along an interface in space and time, drawn progressively; of a surface, a map at each time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from ruptfx import RuptfxError
from ruptfx.results.analysis.surface import SurfaceInterpolation, magnitude_of
from ruptfx.results.figure_style import RATE_MAP, Array, scale
from ruptfx.results.movies import Film
from ruptfx.results.plots import surface_maps as _surface
from ruptfx.results.plots._record import along, has_slip_rates, has_surface, rate_range
from ruptfx.results.record import Record

ROWS, COLUMNS = 400, 900


def slip_rate(record: Record) -> Film:
    """Return the film of the slip rate along `record.interface`, or on it."""
    nothing = RuptfxError(f"{record.path}: nothing slid; there is no slip rate to show")
    if has_surface(record):
        return _on_surface(record, nothing)
    if not has_slip_rates(record):
        raise nothing
    data = record.interface
    position, time, rate = data["position"].values, data["time"].values, np.abs(data["slip_rate"].values)
    low, high, logarithmic = rate_range(record.interface, rate)
    if not np.any(rate > low):
        raise nothing
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(time, "s")
    size, unit = scale(high, "m/s")
    across = np.linspace(position[0], position[-1], COLUMNS)
    when = np.linspace(time[0], time[-1], ROWS)
    near = [np.abs(grid[:, None] - values).argmin(axis=1) for grid, values in ((when, time), (across, position))]
    rates = rate[np.ix_(*near)] / size

    def image(row: int) -> Array:
        return np.where((when <= time[row])[:, None] & (rates * size > low), rates, np.nan)

    def move(axes: Axes, row: int) -> None:
        for line in axes.lines:
            line.remove()
        axes.axhline(time[row] / t_size, color="black", lw=0.6)

    norm = (LogNorm if logarithmic else Normalize)(low / size, max(high, 2 * low) / size)
    return Film(
        time, image, (position[0] / x_size, position[-1] / x_size, time[0] / t_size, time[-1] / t_size),
        along(record, x_size, x_unit), f"Time ({t_unit})", f"Magnitude of slip rate ({unit})",
        {"norm": norm, "cmap": RATE_MAP.with_extremes(bad="white"), "extend": "both"}, move=move, aspect="auto",
    )  # fmt: skip


def _on_surface(record: Record, nothing: RuptfxError) -> Film:
    """Return the film of the slip rate on `record.interface`, a surface: strike to the right, dip downwards."""
    data = record.interface
    time, strike, dip = (data[name].values for name in ("time", "position", "dip"))
    rates = [magnitude_of(data, "slip_rate", row) for row in range(len(time))]
    threshold = float(data.attrs["rupture_threshold"])
    sliding = np.concatenate([rate[rate > threshold] for rate in rates])
    if not len(sliding):
        raise nothing
    size, unit = scale(float(np.quantile(sliding, 0.999)), "m/s")
    length, _ = _surface.axis_scale(data)
    left, right, top, bottom = strike.min(), strike.max(), dip.min(), dip.max()
    pixel = max(right - left, bottom - top) / COLUMNS
    sides = (left, right), (bottom, top)
    x, y = (np.linspace(low, high, max(2, round(abs(high - low) / pixel))) for low, high in sides)
    at_pixels = SurfaceInterpolation(data, *(each.ravel() for each in np.meshgrid(x, y)))

    def image(row: int) -> Array:
        return at_pixels(rates[row] / size).reshape(len(y), len(x))

    names = _surface.axis_names(data)
    look = {"cmap": RATE_MAP, "vmin": 0.0, "vmax": float(np.quantile(sliding, 0.999)) / size, "extend": "max"}
    extent = (left / length, right / length, bottom / length, top / length)
    return Film(time, image, extent, *names, f"Slip rate ({unit})", look)
