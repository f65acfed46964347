"""Figure of pressure, contact states and slip on the surface of a sliding contact between solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize

from ruptfx.results.analysis import slides_far
from ruptfx.results.analysis.real_contact import Box, contact_area, contact_box, touching
from ruptfx.results.analysis.surface import SurfaceInterpolation, grid
from ruptfx.results.figure_style import RATE_MAP, Array, edges, scale
from ruptfx.results.plots import surface_maps as _surface
from ruptfx.results.plots._record import chosen, has_surface
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.plots._states import COLOURS, explain, names_of
from ruptfx.results.record import Data, Files

PANELS = ("pressure", "states", "slip")
ARROWS, ARROW = 16, "#2a6099"  # arrows of slip along the longer extent, and their colour
RASTER = 300  # lines of a raster of points that form no grid


def suits(record: Files) -> bool:
    """Return whether a surface has finite sliding and saved times."""
    return has_surface(record) and slides_far(record.interface) and record.interface.sizes["time"] > 0


@figure
def contact_maps(
    sheet: Sheet, record: Files, *, at: float | None = None, field: str | Sequence[str] | None = None,
    whole: bool = False,
) -> None:  # fmt: skip
    """Draw maps of the contact pressure, of the contact states, and of slip with arrows, at one time.

    Points are at their initial positions on the plus side. If the contact is small, the part of the surface with all
    points that touch at some record is drawn.

    Parameters
    ----------
    at : float, optional
        Time [s]; the nearest saved one is drawn. Default: the last one.
    field : str or sequence of str, optional
        Panels: "pressure", "states", "slip". Default: all.
    whole : bool
        Draw the whole surface.
    """
    data = record.interface
    saved = data["time"].values
    row = int(chosen(saved, at, np.array([len(saved) - 1]))[0])
    wanted = sheet.choose(field, PANELS)
    box = _surface.ends_of(data) if whole else contact_box(data)
    height = _surface.DRAWN * np.ptp(box[1]) / max(np.ptp(box[0]), 1e-300) / len(wanted)
    axes = sheet.panels(1, len(wanted), float(np.clip(1.5 + height, 2.2, 6.0)), sharey=True)[0]
    lengths = sheet.scale("x", float(np.ptp(box, axis=1).max()), "m")
    states = data["contact"].values[row].astype(int)
    for ax, name in zip(axes, wanted, strict=True):
        if name == "states":
            _draw_states(ax, data, states, lengths)
        elif name == "pressure":
            _draw_pressure(sheet, ax, data, row, lengths)
        else:
            _draw_slip(sheet, ax, data, row, lengths, box)
        along, across = _surface.axis_names(data, lengths)
        ax.set(xlabel=along, ylabel=across if ax is axes[0] else "", aspect="equal", anchor="S")
        ax.set(xlim=np.array(box[0]) / lengths[0], ylim=np.array(box[1][::-1]) / lengths[0])
    t_size, t_unit = sheet.scale("time", saved, "s")
    axes[-1].set_title(f"{saved[row] / t_size:.4g} {t_unit}", loc="right")
    sheet.letter(axes)
    sheet.remark(area_text(data, row))


def area_text(data: Data, row: int) -> str:
    """Return a sentence on the real area of contact at a record."""
    area, whole = float(contact_area(data)[row]), float(data["area"].values.sum())
    size, unit = area_scale(area)
    return f"Real area of contact: {area / size:.4g} {unit}, {100 * area / whole:.3g} % of the surface."


def area_scale(area: float) -> tuple[float, str]:
    """Return size and name of a readable unit for an area [m2], whose value is above 0.008 and up to 8000."""
    size, unit = scale(10 * np.sqrt(area), "m")
    return size**2, f"{unit}²"


def _draw_pressure(sheet: Sheet, ax: Axes, data: Data, row: int, lengths: tuple[float, str]) -> None:
    values = data["normal_stress"].values[row]
    size, unit = sheet.scale("traction", values, "Pa")
    norm = Normalize(0, max(float(values.max()) / size, 0.0) or 1.0)
    drawn = _surface.draw(ax, data, np.maximum(values / size, 0.0), norm, RATE_MAP, lengths)
    sheet.figure.colorbar(drawn, ax=ax, label=f"Pressure ({unit})", orientation="horizontal", location="top")


def _draw_states(ax: Axes, data: Data, states: Array, lengths: tuple[float, str]) -> None:
    colours, norm = (
        ListedColormap(list(COLOURS.values())),
        BoundaryNorm(np.arange(len(COLOURS) + 1) - 0.5, len(COLOURS)),
    )
    positions, size = grid(data), lengths[0]
    if positions is None:
        s, d, table = _nearest(data, states)
    else:
        s, d = positions
        table, order = states.reshape(len(s), len(d)).T, np.argsort(d)
        d, table = d[order], table[order]
    ax.pcolormesh(edges(s / size), edges(d / size), table, cmap=colours, norm=norm, rasterized=True)
    ax.set(xlim=(s.min() / size, s.max() / size), ylim=(d.max() / size, d.min() / size))
    anchor = (0.5, 1.0)
    shown = names_of(states)
    explain(ax, shown, per_line=2, loc="lower center", bbox_to_anchor=anchor, columnspacing=0.8, handlelength=1.0)


def _nearest(data: Data, states: Array) -> tuple[Array, Array, Array]:
    """Return lines of a raster along strike and down dip [m], and the states of the nearest points on it.

    States are NaN outside of the surface.
    """
    from scipy.spatial import cKDTree  # imported late: ordinary runs do not need it

    points = np.stack([data[name].values for name in ("position", "dip")], axis=1)
    s, d = (np.linspace(each.min(), each.max(), RASTER) for each in points.T)
    places = np.stack(np.meshgrid(s, d), axis=-1)
    outside = np.isnan(SurfaceInterpolation(data, *places.reshape(-1, 2).T)(np.ones(len(points))))
    nearest = states[cKDTree(points).query(places)[1]]
    return s, d, np.where(outside.reshape(nearest.shape), np.nan, nearest)


def _draw_slip(
    sheet: Sheet, ax: Axes, data: Data, row: int, lengths: tuple[float, str], box: Box
) -> None:  # fmt: skip
    slip = slip_of_contact(data, row)
    amount = np.linalg.norm(slip, axis=1)
    size, unit = sheet.scale("slip", amount, "m")
    norm = Normalize(0, max(float(amount.max()) / size, 0.0) or 1.0)
    drawn = _surface.draw(ax, data, amount / size, norm, RATE_MAP, lengths)
    sheet.figure.colorbar(drawn, ax=ax, label=f"Slip ({unit})", orientation="horizontal", location="top")
    chosen_points = thinned(data, amount > 0.02 * amount.max(), box)
    if len(chosen_points):
        strike, dip = (data[name].values[chosen_points] / lengths[0] for name in ("position", "dip"))
        ways = slip[chosen_points] / amount[chosen_points, None]
        ax.quiver(strike, dip, *ways.T, angles="xy", scale=1.2 * ARROWS, width=0.006, color=ARROW)


def slip_of_contact(data: Data, row: int) -> Array:
    """Return the slip at a record along both tangents [m], shape (points, 2), zero where points do not touch."""
    slip = np.stack([data[f"slip_{k}"].values[row] for k in (1, 2)], axis=1)
    return np.where(touching(data, row)[:, None], slip, 0.0)


def thinned(data: Data, wanted: Array, box: Box) -> Array:
    """Return the index of one of the wanted points in every square of a coarse grid over a part of the surface."""
    step = np.ptp(box, axis=1).max() / ARROWS
    squares = np.stack([np.floor(data[name].values / step) for name in ("position", "dip")], axis=1)[wanted]
    return np.flatnonzero(wanted)[np.unique(squares, axis=0, return_index=True)[1]]
