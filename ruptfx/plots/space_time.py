"""Figure of the slip rate in space and time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator

from ruptfx.analysis import rupture_origin
from ruptfx.analysis.modes import LEVEL
from ruptfx.figure_style import GUIDE, RATE_MAP, edges, new_figure, note, remark, scale, styled
from ruptfx.plots._record import along, end_time, guides, has_slip_rates, is_uneven, rate_range, whose_speeds
from ruptfx.record import Files

WIDE, HIGH = 0.09, 0.05  # parts of the picture that a label takes


def suits(record: Files) -> bool:
    """Whether the run slides and one scale of time shows it."""
    return has_slip_rates(record) and not is_uneven(record)


@styled
def space_time(record: Files) -> Figure:
    """Slip rate against position and time, with lines that run from the loaded end at the wave speeds.

    White is slower than the sliding threshold (2 % of the driven speed). Colours are logarithmic where narrow
    pulses are ten times faster than the rest.
    """
    data = record.interface
    position, time, rate = data["position"].values, data["time"].values, np.abs(data["slip_rate"].values)
    until = end_time(record)
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(until, "s")
    figure, axes = new_figure(1, 1, 3.6, 4.8)
    ax = axes[0, 0]
    ax.set(
        xlabel=along(record, x_size, x_unit), ylabel=f"Time ({t_unit})",
        xlim=(position[0] / x_size, position[-1] / x_size), ylim=(0, until / t_size),
    )
    peak, white = rate.max(initial=0.0), ""
    if peak > 0 and len(time) > 1:
        low, high, logarithmic = rate_range(record, rate)
        size, unit = scale(high, "m/s")
        norm = (LogNorm if logarithmic else Normalize)(low / size, max(high, 2 * low) / size)
        shown = np.ma.masked_less(rate, low) / size
        grid = edges(position) / x_size, edges(time) / t_size
        colours = RATE_MAP.with_extremes(under="white")
        mesh = ax.pcolormesh(*grid, shown, norm=norm, cmap=colours, rasterized=True)
        # Less than two decades need numbers between their powers of ten.
        ticks = LogLocator(subs=(1, 2, 5)) if logarithmic and high < 100 * low else None
        label = f"Magnitude of slip rate ({unit})"
        bar = figure.colorbar(mesh, ax=ax, label=label, ticks=ticks, extend="both", pad=0.03)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.yaxis.set_minor_formatter("")
        white = f"White: slower than {low / size:.3g} {unit}, which does not count as sliding."
    if peak <= LEVEL * data.attrs.get("V_imp", 0):
        note(ax, "no sliding")
    _rays(ax, record, x_size, t_size)
    remark(figure, white, whose_speeds(record))
    return figure


def _rays(ax: Axes, record: Files, x_size: float, t_size: float) -> None:
    """Lines x = x_0 +- c (t - t_0), to both sides of an inner origin, labelled where they leave the picture."""
    start, begin = (value / size for value, size in zip(rupture_origin(record), (x_size, t_size), strict=True))
    (left, right), top = ax.get_xlim(), ax.get_ylim()[1]
    halo = [withStroke(linewidth=1.5, foreground="white")]
    labelled: list[tuple[float, float]] = []  # where, in parts of the picture
    for name, speed, style in guides(record):
        slope = speed * t_size / x_size
        for sign, room in ((1, right - start), (-1, start - left)):
            if room < 0.02 * (right - left):
                continue
            reach = min(room, slope * (top - begin))
            end = (start + sign * reach, begin + reach / slope)
            ax.plot([start, end[0]], [begin, end[1]], style, color=GUIDE, lw=0.8, gid="ray", path_effects=halo)
            at_side = reach >= room
            if sign < 0 and right > start:
                continue  # labels at one side are enough
            # c_R and c_s are close: above the picture their labels lean away from each other.
            leans_left = not at_side and (name == "$c_R$") == (sign > 0)
            place = (end[0] - left) / (right - left), end[1] / top
            if not leans_left and any(abs(x - place[0]) < WIDE and abs(y - place[1]) < HIGH for x, y in labelled):
                continue  # a run that was stopped early: there is no room for another one
            if not leans_left:
                labelled.append(place)
            ax.annotate(
                name, end, (3, 0) if at_side else (0, 3), textcoords="offset points", color=GUIDE,
                ha="right" if leans_left else "left", va="center" if at_side else "bottom",
                annotation_clip=False, path_effects=halo,
            )
