"""Figure of the arrival of the rupture and its speed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.front import local_speed
from ruptfx.figure_style import GUIDE, Array, letter, new_figure, note, remark, scale, styled
from ruptfx.plots._record import along, end_time, guides, has_front, is_uneven, not_resolved, whose_speeds
from ruptfx.record import Files

SLOW = 0.02  # of the slowest wave speed: slower fronts are drawn without wave speeds
ROOM = 0.07  # height of a label over that of a panel


def suits(record: Files) -> bool:
    """Return whether the run has a front and evenly saved times."""
    return has_front(record) and not is_uneven(record)


@styled
def front(record: Files) -> Figure:
    """Draw the arrival of the rupture and its local speed along the interface, with the wave speeds.

    The speed is the slope of a least-squares line through the arrivals in a window of 5 % of the interface, or of five
    points where that is more; a window with fronts in both directions, as around an inner origin, has none. A panel
    without a speed states why. Fronts far slower than waves are drawn without wave speeds.
    """
    data = record.interface
    position, arrival = data["position"].values, data["rupture_time"].values
    arrival = np.where((arrival >= record.since) & (arrival <= record.until), arrival, np.nan)
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(end_time(record), "s")
    figure, (axes,) = new_figure(1, 2, 2.6, sharex=True)
    axes[0].plot(position / x_size, arrival / t_size, ".-", ms=2, color="#1a1a1a")  # a point may stand alone
    axes[0].set(xlabel=along(record, x_size, x_unit), ylabel=f"Rupture time ({t_unit})")
    axes[0].set_xlim(position[0] / x_size, position[-1] / x_size)
    speeds = guides(record)
    fastest = max((guide.speed for guide in speeds), default=1.0)
    window = max(0.05 * np.ptp(position), 5 * float(np.median(np.diff(position))))
    local = np.abs(local_speed(position, arrival, window))
    local[_both_ways(position, arrival, window)] = np.nan
    together = local > 3 * fastest
    local[together] = np.nan
    shown = np.append(local[np.isfinite(local)], 0.0)
    typical = float(np.quantile(shown, 0.9))
    if typical < SLOW * min((guide.speed for guide in speeds), default=0.0):
        speeds = []
    top = 1.35 * max([typical, *(guide.speed for guide in speeds)]) or 1.0
    size, unit = (1e3, "km/s") if top > 1200 else scale(top, "m/s")
    axes[1].plot(position / x_size, local / size, ".-", ms=2, color="#1a1a1a")
    axes[1].set(xlabel=along(record, x_size, x_unit), ylabel=f"Rupture speed ({unit})", ylim=(0, top / size))
    heights = spread(np.array([guide.speed for guide in speeds]) / top, ROOM)
    for (name, speed, style), height in zip(speeds, heights, strict=True):
        axes[1].axhline(speed / size, ls=style, color=GUIDE, lw=0.8)
        axes[1].annotate(name, (1, height), (3, 0), xycoords="axes fraction", textcoords="offset points",
                         color=GUIDE, va="center", annotation_clip=False)
    if not np.isfinite(arrival).any():
        for ax in axes:
            note(ax, "no sliding")
    elif len(shown) == 1:
        note(axes[1], "no front: the points\nslide at once" if together.any() else "no speed: fewer than four points\n"
             "of a window slid one after another")  # fmt: skip
    remark(figure, whose_speeds(record) if speeds else "", not_resolved(record))
    letter(axes)
    return figure


def spread(heights: Array, room: float) -> Array:
    """Return the heights of labels, in order, moved apart by the least amount that avoids overlap."""
    order = np.argsort(heights)
    groups = [[float(height)] for height in heights[order]]

    def bottom(group: list[float]) -> float:
        return float(np.mean(group)) - room * (len(group) - 1) / 2

    merged: list[list[float]] = []
    for group in groups:
        merged.append(group)
        while len(merged) > 1 and bottom(merged[-1]) < bottom(merged[-2]) + room * len(merged[-2]):
            merged[-2:] = [merged[-2] + merged[-1]]
    placed = [bottom(group) + room * number for group in merged for number in range(len(group))]
    found: Array = np.empty(len(heights))
    found[order] = placed
    return found


def _both_ways(position: Array, arrival: Array, width: float) -> Array:
    """Return the points in whose window at least a tenth of the arrivals run against the others."""
    middle, step = (position[1:] + position[:-1]) / 2, np.diff(arrival)
    first, last = (np.searchsorted(middle, position + shift) for shift in (-width / 2, width / 2))
    later, earlier = (np.append(0, np.cumsum(way)) for way in (step > 0, step < 0))
    later, earlier = later[last] - later[first], earlier[last] - earlier[first]
    both: Array = (later + earlier > 0) & (np.minimum(later, earlier) >= 0.1 * (later + earlier))
    return both
