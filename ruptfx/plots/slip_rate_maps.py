"""Figure of the slip rate on a surface at several times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize

from ruptfx import RuptfxError
from ruptfx.analysis.surface import magnitude_of
from ruptfx.figure_style import RATE_MAP, Array
from ruptfx.plots import _surface
from ruptfx.plots._record import chosen, has_surface, nearest
from ruptfx.plots._sheet import Sheet, Window, figure
from ruptfx.record import Data, Files
from ruptfx.schema import nearest as nearest_name

UNITS = {"slip_rate": "m/s", "slip": "m", "shear_traction": "Pa"}
COLUMNS = 2


def suits(record: Files) -> bool:
    """Return whether the run has a surface and a record."""
    return has_surface(record) and record.interface.sizes["time"] > 0


@figure
def slip_rate_maps(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str = "slip_rate",
) -> None:
    """Draw the slip rate, or another field, on the surface at several times, with one scale of colours.

    Parameters
    ----------
    at
        Times [s]; the nearest saved ones are drawn. Default: six while the rupture runs.
    field : str
        Tangential field, of which the magnitude is drawn: "slip_rate", "slip", "shear_traction".
    """
    data = record.interface
    known = [name.removesuffix("_1") for name in map(str, data) if name.endswith("_1")]
    if field not in known:
        raise RuptfxError(f"plots.slip_rate_maps: field = '{field}': {nearest_name(str(field), known)}")
    saved = data["time"].values
    wanted = _while_it_runs(data)[-1:] if sheet.is_given else _while_it_runs(data)
    rows = np.unique(chosen(saved, at, nearest(saved, wanted)))
    values = np.array([magnitude_of(data, field, int(row)) for row in rows])
    size, unit = sheet.scale(field, values, str(data[f"{field}_1"].attrs.get("units", UNITS.get(field, "1"))))
    high = float(np.quantile(values, 0.999)) or 1.0
    ratio = np.ptp(data["dip"].values) / max(np.ptp(data["position"].values), 1e-300)
    columns = min(COLUMNS, len(rows))
    lines = -(-len(rows) // columns)
    height = float(np.clip(0.6 + lines * (0.35 + 2.7 * ratio), 2.0, 8.5))
    sheet.one_of("choose one time with at = 3.0")
    axes = sheet.panels(lines, columns, height, sharex=True, sharey=True)
    t_size, t_unit = sheet.scale("time", float(saved.max()), "s")
    x_scale = sheet.scale("x", _surface.extent(data), "m")
    for number, (row, each) in enumerate(zip(rows, values, strict=True)):
        ax = axes.flat[number]
        drawn = _surface.draw(ax, data, each / size, Normalize(0, high / size), RATE_MAP, x_scale)
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
        _surface.label(ax, data, number % columns == 0, number >= len(rows) - columns, x_scale)
        _surface.window(ax, x, x_scale, sheet.name)
    for ax in axes.flat[len(rows) :]:
        ax.set_visible(False)
    label = field.replace("_", " ").capitalize()
    sheet.figure.colorbar(drawn, ax=axes.ravel().tolist(), label=f"{label} ({unit})", shrink=0.7)
    sheet.letter(axes.ravel()[: len(rows)])
    said = f"Colours end at {high / size:.3g} {unit}; the largest value is {values.max() / size:.3g}."
    sheet.remark(said if values.max() > high else "")


def _while_it_runs(data: Data) -> Array:
    """Return six times between the first and the last rupture of a point, or of the whole run without one [s]."""
    arrival, saved = data["rupture_time"].values, data["time"].values
    ends = arrival[np.isfinite(arrival)] if np.isfinite(arrival).any() else saved
    return np.linspace(ends.min(), ends.max(), 7)[1:]
