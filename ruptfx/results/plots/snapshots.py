"""Figure of slip rate and tractions along the interface at several times."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from ruptfx.results.analysis import rupture_origin
from ruptfx.results.figure_style import GUIDE, MUTED, Array, limit
from ruptfx.results.plots._record import (
    along,
    at_positions,
    chosen,
    default_times,
    guides,
    has_origin,
    has_slip_rates,
    is_uneven,
    not_resolved,
    open_faces,
    quantity,
    rate_range,
    signed,
    turned,
    whose_speeds,
)
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.plots._states import COLOURS
from ruptfx.results.record import Data, Files
from ruptfx.results.strength import strength

FIELDS = {"slip_rate": "#c1440e", "shear_traction": "#1a1a1a", "normal_stress": "#3a7d44"}
CONSTANT = 1e-6  # of the normal stress: smaller changes are rounding
LETTERS = 21  # that a row is high
FAR = 3.0  # times the largest traction: a higher strength is cut off


def suits(record: Files) -> bool:
    """Return whether the run has slip rates and evenly saved times."""
    return has_slip_rates(record) and not is_uneven(record)


@figure
def snapshots(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str | Sequence[str] | None = None,
) -> None:
    """Draw slip rate, shear traction and normal stress along the interface at several times, one row each.

    Thin vertical lines: distances that c_s and c_l reach from the loaded end. Slip rate and shear traction are positive
    in the direction of the slip; a remark states if that reverses their sign. The dotted line of the shear traction is
    the strength, if it can be computed. Slip rates have a logarithmic axis if pulses are narrow, and gaps
    where faces are open. Axes of tractions leave out single values far beyond the others, as at corners. A normal
    stress that is the same everywhere and at all times is stated in the remark, and so are slip rates that are zero.

    Parameters
    ----------
    at
        Times [s]; the nearest saved ones are drawn. Default: four while the rupture runs.
    field
        Fields of the interface, a column each. Default: "slip_rate" if any point slips, "shear_traction", and
        "normal_stress" if it changes.
    """
    data = at_positions(record.interface, x, sheet.name)
    saved = data["time"].values
    rows = chosen(saved, at, default_times(record, saved, 1 if sheet.is_given else 4))
    if not len(rows):
        sheet.empty("no time was saved", "Position along the interface (m)", "Time (s)")
        return
    away = open_faces(data, rows)
    if field is None:
        wanted, constant = _default(data, sheet, bool(away.any()))
    else:
        wanted, constant = [field] if isinstance(field, str) else list(field), ""
    meant = {name: quantity(data, name, sheet.name) for name in wanted}
    position = data["position"].values
    x_size, x_unit = sheet.scale("x", np.ptp(position), "m")
    sheet.one_of(f"choose one with field = '{wanted[0]}' and at = 30e-6")
    axes = sheet.panels(len(rows), len(meant), 0.6 + 1.4 * len(rows), sharex=True, sharey="col")
    axes[0, 0].set_xlim(position[0] / x_size, position[-1] / x_size)
    marked, cut = False, False
    strengths = strength(record, rows) if "shear_traction" in meant else None
    if strengths is not None:
        strengths = strengths[:, np.isin(record.interface["position"].values, position)]
    for column, (name, (title, unit)) in enumerate(meant.items()):
        values = data[name].isel(time=rows).values * signed(record, name)
        if name == "slip_rate":
            values = np.where(away, np.nan, values)
        size, printed = sheet.scale(name, values, unit)
        colour = FIELDS.get(name, GUIDE)
        for number, (ax, row, line) in enumerate(zip(axes[:, column], rows, values / size, strict=True)):
            if name == "slip_rate":
                ax.fill_between(position / x_size, line, color=colour, alpha=0.25, lw=0)
                ax.fill_between(position / x_size, 0, 1, away[number], transform=ax.get_xaxis_transform(), lw=0,
                                step="mid", color=COLOURS["open"], gid="open", zorder=0)  # fmt: skip
            ax.plot(position / x_size, line, color=colour)
            if name == "shear_traction" and strengths is not None:
                ax.plot(position / x_size, strengths[number] / size, ":", color=MUTED, lw=0.9, gid="strength", zorder=0)
            ax.set_ylabel(fill(title if printed == "1" else f"{title} ({printed})", LETTERS))
            named = column > 0 or len(meant) == 1
            marked |= has_origin(record) and _marks(ax, record, saved[row], x_size, named=named)
        axes[-1, column].set_xlabel(along(record, x_size, x_unit))
        if not np.isnan(values).all():
            limiting = strengths if name == "shear_traction" else None
            cut |= _limits(axes[0, column], data, name, values, size, limiting)
    t_size, t_unit = sheet.scale("time", saved, "s")
    for ax, row in zip(axes[:, 0], rows, strict=True):
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
    drawn = strengths is not None and bool(np.isfinite(strengths).any())
    known = "Dotted beside the shear traction: the strength." if drawn else ""
    grey = "Grey: the faces are open, without a slip rate." if away.any() and "slip_rate" in meant else ""
    beyond = "Single values beyond the axes of the tractions are not shown." if cut else ""
    backward = turned(record) if any(signed(record, name) < 0 for name in meant) else ""
    speeds = whose_speeds(record) if marked else ""
    sheet.letter(axes)
    sheet.remark(known, constant, grey, beyond, backward, speeds, not_resolved(record))


def _default(data: Data, sheet: Sheet, opened: bool) -> tuple[list[str], str]:
    """Return the fields to draw, and as sentences a normal stress that never changes and a slip rate that is zero."""
    # Open faces are marked in the column of the slip rate.
    names = [name for name in FIELDS if name != "slip_rate" or opened or data[name].values.any()]
    still = "" if "slip_rate" in names else "No point slips."
    normal = data["normal_stress"].values
    largest = float(np.abs(normal).max(initial=0.0))
    if float(np.ptp(normal)) > CONSTANT * largest or not largest:
        return names, still
    size, unit = sheet.scale("normal_stress", largest, "Pa")
    return [name for name in names if name != "normal_stress"], f"{still} " * bool(still) + (
        f"The normal stress is {float(normal.flat[0]) / size:.4g} {unit} everywhere and at all times."
    )


def _limits(ax: Axes, data: Data, name: str, values: Array, size: float, strengths: Array | None) -> bool:
    """Set the limits of a column; return whether single values lie beyond them."""
    middle, largest = np.nanmean(values) / size, np.nanmax(np.abs(values)) / size
    cut = name != "slip_rate" and limit(ax, values, size)
    top = 0.0 if strengths is None else float(np.nanmax(strengths)) / size
    if top > FAR * largest > 0:  # glued: it would flatten the traction
        ends = values.min() / size, values.max() / size
        room = 0.1 * (np.ptp(ends) or largest)
        ax.set_ylim(ends[0] - room, ends[1] + room)
    if (np.nanmax(values) - np.nanmin(values)) / size < 0.01 * largest:  # show rounding as what it is
        ax.set_ylim(middle - 0.05 * largest, middle + 0.05 * largest)
    low, _, logarithmic = rate_range(data, np.nan_to_num(np.abs(values)))
    if name == "slip_rate" and logarithmic:
        ax.set_yscale("log", nonpositive="clip")
        ax.set_ylim(low / size, 2 * np.nanmax(values) / size)
        if np.nanmax(values) < 100 * low:  # powers of ten alone would be too few
            ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.yaxis.set_major_formatter("{x:g}")
            ax.yaxis.set_minor_formatter(NullFormatter())
    return cut


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
            ax.annotate(
                name,
                (place, 1),
                (0, 1),
                xycoords=("data", "axes fraction"),
                color=GUIDE,
                textcoords="offset points",
                ha="center",
                va="bottom",
                annotation_clip=False,
            )
    return seen
