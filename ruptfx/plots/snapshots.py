"""Figure of slip rate and tractions along the interface at several times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ruptfx.analysis import rupture_origin
from ruptfx.figure_style import GUIDE, MUTED, empty_figure, letter, limit, new_figure, remark, scale, styled
from ruptfx.plots._record import (
    along,
    default_times,
    direction,
    guides,
    has_origin,
    has_slip_rates,
    is_uneven,
    nearest,
    not_resolved,
    open_faces,
    rate_range,
    turned,
    whose_speeds,
)
from ruptfx.plots._states import COLOURS
from ruptfx.plots._strength import strength
from ruptfx.record import Files

FAR = 3.0  # times the largest traction: a higher strength is cut off


def suits(record: Files) -> bool:
    """Return whether the run has slip rates and evenly saved times."""
    return has_slip_rates(record) and not is_uneven(record)


@styled
def snapshots(record: Files, times: Sequence[float] | None = None) -> Figure:
    """Draw slip rate, shear traction and normal stress along the interface at several times, one row each.

    Thin vertical lines: distances that c_s and c_l reach from the loaded end. Slip rate and shear traction are positive
    in the direction of the slip; a remark states if that reverses their sign. The dotted line of the shear traction is
    the strength, if it can be computed. Slip rates have a logarithmic axis if pulses are narrow, and gaps
    where faces are open. Axes of tractions leave out single values far beyond the others, as at corners.

    Parameters
    ----------
    record : Record or Files
    times : sequence of float, optional
        Times [s]; the nearest saved ones are drawn. Default: four while the rupture runs.
    """
    data = record.interface
    saved = data["time"].values
    rows = default_times(record, saved, 4) if times is None else nearest(saved, np.asarray(times))
    if not len(rows):
        return empty_figure("no time was saved", "Position along the interface (m)", "Time (s)")
    position, sign = data["position"].values, direction(record)
    x_size, x_unit = scale(np.ptp(position), "m")
    strengths = strength(record, rows)
    names = {"slip_rate": ("Slip rate", "m/s"), "shear_traction": ("Shear traction", "Pa"),
             "normal_stress": ("Normal stress", "Pa")}
    figure, axes = new_figure(len(rows), 3, 0.6 + 1.4 * len(rows), sharex=True, sharey="col")
    axes[0, 0].set_xlim(position[0] / x_size, position[-1] / x_size)
    marked, cut, away = False, False, open_faces(data, rows)
    for column, (name, (title, unit)) in enumerate(names.items()):
        values = data[name].isel(time=rows).values * (1.0 if name == "normal_stress" else sign)
        if name == "slip_rate":
            values = np.where(away, np.nan, values)
        size, printed = scale(values, unit)
        for number, (ax, row, line) in enumerate(zip(axes[:, column], rows, values / size, strict=True)):
            if name == "slip_rate":
                ax.fill_between(position / x_size, line, color="#c1440e", alpha=0.25, lw=0)
                ax.fill_between(position / x_size, 0, 1, away[number], transform=ax.get_xaxis_transform(), lw=0,
                                step="mid", color=COLOURS["open"], gid="open", zorder=0)  # fmt: skip
            ax.plot(position / x_size, line, color=("#c1440e", "#1a1a1a", "#3a7d44")[column])
            if name == "shear_traction" and strengths is not None:
                ax.plot(position / x_size, strengths[number] / size, ":", color=MUTED, lw=0.9, gid="strength", zorder=0)
            ax.set_ylabel(f"{title} ({printed})")
            marked |= has_origin(record) and _marks(ax, record, saved[row], x_size, named=column > 0)
        axes[-1, column].set_xlabel(along(record, x_size, x_unit))
        if np.isnan(values).all():
            continue
        middle, largest = np.nanmean(values) / size, np.nanmax(np.abs(values)) / size
        if name != "slip_rate":
            cut |= limit(axes[0, column], values, size)
        if name == "shear_traction":
            top = 0.0 if strengths is None else float(np.nanmax(strengths)) / size
            if top > FAR * largest > 0:  # glued: it would flatten the traction
                ax_range = values.min() / size, values.max() / size
                room = 0.1 * (np.ptp(ax_range) or largest)
                axes[0, column].set_ylim(ax_range[0] - room, ax_range[1] + room)
        if (np.nanmax(values) - np.nanmin(values)) / size < 0.01 * largest:  # show rounding as what it is
            axes[0, column].set_ylim(middle - 0.05 * largest, middle + 0.05 * largest)
        low, _, logarithmic = rate_range(record, np.nan_to_num(np.abs(values)))
        if name == "slip_rate" and logarithmic:
            axes[0, 0].set_yscale("log", nonpositive="clip")
            axes[0, 0].set_ylim(low / size, 2 * np.nanmax(values) / size)
            if np.nanmax(values) < 100 * low:  # powers of ten alone would be too few
                axes[0, 0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axes[0, 0].yaxis.set_major_formatter("{x:g}")
                axes[0, 0].yaxis.set_minor_formatter(NullFormatter())
    t_size, t_unit = scale(saved, "s")
    for ax, row in zip(axes[:, 0], rows, strict=True):
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
    known = "" if strengths is None else "Dotted beside the shear traction: the strength."
    grey = "Grey: the faces are open, without a slip rate." if away.any() else ""
    beyond = "Single values beyond the axes of the tractions are not shown." if cut else ""
    remark(figure, known, grey, beyond, turned(record), whose_speeds(record) if marked else "", not_resolved(record))
    letter(axes.ravel())
    return figure


def _marks(ax: Axes, record: Files, time: float, x_size: float, named: bool) -> bool:
    """Mark the distances that waves have travelled; return whether any is in view."""
    seen = False
    start, begin = rupture_origin(record)
    left, right = ax.get_xlim()
    labelled = left + 0.1 * (right - left)  # keeps labels clear of the panel letter and of each other
    fronts = sorted(
        ((start + sign * speed * (time - begin)) / x_size, name, style)
        for sign in (-1, 1) for name, speed, style in guides(record, "c_s", "c_p")
    )  # fmt: skip
    for place, name, style in fronts:
        if not (time > begin and left < place < right):
            continue
        seen = True
        ax.axvline(place, color=GUIDE, lw=0.5, ls=style, zorder=0)
        if named and place > labelled + 0.08 * (right - left):
            labelled = place
            ax.annotate(name, (place, 1), (0, 1), xycoords=("data", "axes fraction"), color=GUIDE,
                        textcoords="offset points", ha="center", va="bottom", annotation_clip=False)
    return seen
