"""Figure of pressure and contact state on the deformed surfaces of a sliding contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ruptfx import RuptfxError
from ruptfx.results.plots._record import chosen, nearest
from ruptfx.results.plots._sheet import Sheet, Window, figure, pair
from ruptfx.results.plots._states import COLOURS, explain, has_states, names_of
from ruptfx.results.record import Files

PANELS = ("tractions", "surfaces")
TIMES = 3


def suits(record: Files) -> bool:
    """Return whether an interface has finite sliding."""
    return has_states(record)


@figure
def surfaces(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str | Sequence[str] | None = None,
) -> None:
    """Draw normal stress and shear traction, and below them both deformed surfaces with the contact states.

    Heights are stretched; the opposite surface is drawn where points are paired with it.

    Parameters
    ----------
    at
        Times [s]; the nearest saved ones are drawn. Default: after a third, two thirds, and all of the run.
    x
        Range of the deformed interface [m]. Default: all.
    field
        Panels: "tractions", "surfaces". Default: both.
    """
    data = record.interface
    saved = data["time"].values
    if not len(saved):
        sheet.empty("no time was saved", "x, displaced (m)", "y, displaced (m)")
        return
    thirds = saved[0] + (saved[-1] - saved[0]) * np.arange(1, TIMES + 1) / TIMES
    rows = np.unique(chosen(saved, at, nearest(saved, thirds[-1:] if sheet.is_given else thirds)))
    names = ("deformed_x", "deformed_y", "paired_x", "paired_y", "normal_stress", "shear_traction", "contact")
    across, up, paired_x, paired_y, normal, shear, contact = (data[name].isel(time=rows).values for name in names)
    ends = (None, None) if x is None else pair(sheet.name, "x", x)
    low, high = (
        float(value) if end is None else end
        for end, value in zip(ends, (np.nanmin(across), np.nanmax(across)), strict=True)
    )
    if not ((across >= low) & (across <= high)).any():
        raise RuptfxError(f"plots.surfaces: x = ({low:g}, {high:g}) has no point of the interface; widen it")
    wanted = sheet.choose(field, PANELS)
    ratios = [{"tractions": 1.0, "surfaces": 0.8}[name] for name in wanted] * len(rows)
    axes = sheet.panels(len(ratios), 1, 0.8 + 0.95 * len(ratios), sharex=True, height_ratios=ratios)[:, 0]
    x_size, x_unit = sheet.scale("x", high - low, "m")
    t_size, t_unit = sheet.scale("time", saved, "s")
    places = {name: axes[number :: len(wanted)] for number, name in enumerate(wanted)}
    if "tractions" in places:
        p_size, p_unit = sheet.scale("traction", np.array([normal.max(), np.abs(shear).max()]), "Pa")
        for ax, along, sigma, tau in zip(places["tractions"], across / x_size, normal, shear, strict=True):
            ax.fill_between(along, sigma / p_size, color="#3a7d44", alpha=0.25, lw=0)
            ax.plot(along, sigma / p_size, color="#3a7d44", label="normal stress")
            ax.plot(along, tau / p_size, color="#1a1a1a", lw=0.8, label="shear traction")
            ax.set_ylabel(f"Traction ({p_unit})")
        places["tractions"][0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    if "surfaces" in places:
        paired = paired_y[np.isfinite(paired_y)]
        y_size, y_unit = sheet.scale("y", max(float(np.ptp(up)), float(np.ptp(paired)) if len(paired) else 0.0), "m")
        for number, ax in enumerate(places["surfaces"]):
            along, height = across[number] / x_size, up[number] / y_size
            ax.plot(paired_x[number] / x_size, paired_y[number] / y_size, color="#888888", lw=0.8)
            colours = np.array(list(COLOURS.values()))[contact[number].astype(int)]
            ax.plot(along, height, color="#888888", lw=0.5, zorder=1)
            ax.scatter(along, height, s=5, c=colours, ec="#555555", lw=0.2, zorder=2)
            ax.set_ylabel(f"y ({y_unit})")
        explain(places["surfaces"][0], names_of(np.array(contact)), loc="lower center", bbox_to_anchor=(0.5, 1.0))
    for ax, row in zip(axes[:: len(wanted)], rows, strict=True):
        ax.set_title(f"{saved[row] / t_size:.4g} {t_unit}", loc="right")
    axes[-1].set(xlabel=f"x, displaced ({x_unit})", xlim=(low / x_size, high / x_size))
    if not sheet.is_given:
        sheet.figure.align_ylabels(axes)
    sheet.letter(axes)
    sheet.remark("Heights are stretched. Circles: points of the plus side; line: the opposite surface, where paired.")
