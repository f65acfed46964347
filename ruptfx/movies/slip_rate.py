"""Slip rate in space and time, drawn progressively."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from ruptfx import RuptfxError
from ruptfx.figure_style import RATE_MAP, Array, scale
from ruptfx.movies import Film
from ruptfx.plots._record import along, has_slip_rates, rate_range
from ruptfx.record import Record

ROWS, COLUMNS = 400, 900


def slip_rate(record: Record) -> Film:
    """Return the film of the slip rate along the first interface."""
    nothing = RuptfxError(f"{record.path}: nothing slid; there is no slip rate to show")
    if not has_slip_rates(record):
        raise nothing
    data = record.interface
    position, time, rate = data["position"].values, data["time"].values, np.abs(data["slip_rate"].values)
    low, high, logarithmic = rate_range(record, rate)
    if not np.any(rate > low):
        raise nothing
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(time, "s")
    size, unit = scale(high, "m/s")
    across = np.linspace(position[0], position[-1], COLUMNS)
    when = np.linspace(time[0], time[-1], ROWS)
    near = [np.abs(grid[:, None] - values).argmin(axis=1) for grid, values in ((when, time), (across, position))]
    whole = rate[np.ix_(*near)] / size

    def image(row: int) -> Array:
        return np.where((when <= time[row])[:, None] & (whole * size > low), whole, np.nan)

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
