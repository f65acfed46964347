"""Figure of the slip rate on a surface at several times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ruptfx.analysis.surface import magnitude_of
from ruptfx.figure_style import RATE_MAP, Array, new_figure, remark, scale, styled
from ruptfx.plots import _surface
from ruptfx.plots._record import has_surface, nearest
from ruptfx.record import Data, Files

COLUMNS = 2


def suits(record: Files) -> bool:
    """Return whether the run has a surface and a record."""
    return has_surface(record) and record.interface.sizes["time"] > 0


@styled
def slip_rate_maps(record: Files, times: Sequence[float] | None = None) -> Figure:
    """Draw the slip rate on the surface at several times, with one scale of colours.

    Parameters
    ----------
    record : Record or Files
    times : sequence of float, optional
        Times [s]; the nearest saved ones are drawn. Default: six while the rupture runs.
    """
    data = record.interface
    saved = data["time"].values
    rows = np.unique(nearest(saved, _while_it_runs(data) if times is None else np.asarray(times)))
    rates = np.array([magnitude_of(data, "slip_rate", int(row)) for row in rows])
    size, unit = scale(rates, "m/s")
    high = float(np.quantile(rates, 0.999)) or 1.0
    ratio = np.ptp(data["dip"].values) / max(np.ptp(data["position"].values), 1e-300)
    lines = -(-len(rows) // COLUMNS)
    height = float(np.clip(0.6 + lines * (0.35 + 2.7 * ratio), 2.0, 8.5))
    figure, axes = new_figure(lines, COLUMNS, height, sharex=True, sharey=True)
    t_size, t_unit = scale(float(saved.max()), "s")
    for number, (row, rate) in enumerate(zip(rows, rates, strict=True)):
        ax = axes.flat[number]
        drawn = _surface.draw(ax, data, rate / size, Normalize(0, high / size), RATE_MAP)
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
        _surface.label(ax, data, number % COLUMNS == 0, number >= len(rows) - COLUMNS)
    for ax in axes.flat[len(rows) :]:
        ax.set_visible(False)
    figure.colorbar(drawn, ax=axes.ravel().tolist(), label=f"Slip rate ({unit})", shrink=0.7)
    said = f"Colours end at {high / size:.3g} {unit}; the largest rate is {rates.max() / size:.3g}."
    remark(figure, said if rates.max() > high else "")
    return figure


def _while_it_runs(data: Data) -> Array:
    """Return six times between the first and the last rupture of a point, or of the whole run without one [s]."""
    arrival, saved = data["rupture_time"].values, data["time"].values
    ends = arrival[np.isfinite(arrival)] if np.isfinite(arrival).any() else saved
    return np.linspace(ends.min(), ends.max(), 7)[1:]
