"""Figure of pressure and contact state on the deformed surfaces of a sliding contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ruptfx.figure_style import empty_figure, letter, new_figure, remark, scale, styled
from ruptfx.plots._record import nearest
from ruptfx.plots._states import COLOURS, explain, has_states
from ruptfx.record import Files

PANELS = 3  # times


def suits(record: Files) -> bool:
    """Return whether an interface has finite sliding."""
    return has_states(record)


@styled
def surfaces(
    record: Files, times: Sequence[float] | None = None, x_range: tuple[float, float] | None = None
) -> Figure:
    """Draw normal stress and shear traction, and below them both deformed surfaces with the contact states.

    Heights are stretched; the opposite surface is drawn where points are paired with it.

    Parameters
    ----------
    record : Record or Files
    times : sequence of float, optional
        Times [s]; the nearest saved ones are drawn. Default: after a third, two thirds, and all of the run.
    x_range : (float, float), optional
        Range of the deformed interface [m]. Default: all.
    """
    data = record.interface
    saved = data["time"].values
    if not len(saved):
        return empty_figure("no time was saved", "x, displaced (m)", "y, displaced (m)")
    wanted = saved[-1] * np.arange(1, PANELS + 1) / PANELS if times is None else np.asarray(times)
    rows = np.unique(nearest(saved, wanted))
    places = ("deformed_x", "deformed_y", "paired_x", "paired_y")
    x, y, faced_x, faced_y, normal, shear, contact = (
        data[name].isel(time=rows).values for name in (*places, "normal_stress", "shear_traction", "contact")
    )
    low, high = x_range or (float(np.nanmin(x)), float(np.nanmax(x)))
    x_size, x_unit = scale(high - low, "m")
    y_size, y_unit = scale(max(float(np.ptp(y)), float(np.ptp(faced_y[np.isfinite(faced_y)], axis=None))), "m")
    p_size, p_unit = scale(np.array([normal.max(), np.abs(shear).max()]), "Pa")
    t_size, t_unit = scale(saved, "s")
    ratios = [1.0, 0.8] * len(rows)
    figure, axes = new_figure(2 * len(rows), 1, 0.8 + 1.9 * len(rows), sharex=True, height_ratios=ratios)
    for number, row in enumerate(rows):
        above, below = axes[2 * number, 0], axes[2 * number + 1, 0]
        along = x[number] / x_size
        above.fill_between(along, normal[number] / p_size, color="#3a7d44", alpha=0.25, lw=0)
        above.plot(along, normal[number] / p_size, color="#3a7d44", label="normal stress")
        above.plot(along, shear[number] / p_size, color="#1a1a1a", lw=0.8,
                   label="shear traction")  # fmt: skip
        above.set_ylabel(f"Traction ({p_unit})")
        above.set_title(f"{saved[row] / t_size:.4g} {t_unit}", loc="right")
        below.plot(faced_x[number] / x_size, faced_y[number] / y_size, color="#888888", lw=0.8)
        colours = np.array(list(COLOURS.values()))[contact[number].astype(int)]
        below.plot(along, y[number] / y_size, color="#888888", lw=0.5, zorder=1)
        below.scatter(along, y[number] / y_size, s=5, c=colours, ec="#555555", lw=0.2, zorder=2)
        below.set_ylabel(f"y ({y_unit})")
    axes[0, 0].set_xlim(low / x_size, high / x_size)
    axes[0, 0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    explain(axes[1, 0], loc="lower center", bbox_to_anchor=(0.5, 1.0))
    axes[-1, 0].set_xlabel(f"x, displaced ({x_unit})")
    figure.align_ylabels(axes[:, 0])
    letter(axes.ravel())
    remark(figure, "Heights are stretched. Circles: points of the plus side; line: what they face, where they face it.")
    return figure
