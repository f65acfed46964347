"""Figure of the arrival of the rupture and its speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ruptfx.results.analysis.front import local_speed
from ruptfx.results.figure_style import GUIDE, Array, note
from ruptfx.results.plots._record import (
    along,
    at_positions,
    end_time,
    guides,
    has_front,
    is_uneven,
    not_resolved,
    whose_speeds,
)
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Data, Files

PANELS = ("rupture_time", "rupture_speed")
SLOW = 0.02  # of the slowest wave speed: slower fronts are drawn without wave speeds
CONNECTED = 5  # sliding points in a row, at least, of a front
ROOM = 0.07  # height of a label over that of a panel


def suits(record: Files) -> bool:
    """Return whether the run has a front and evenly saved times."""
    return has_front(record) and not is_uneven(record)


@figure
def front(sheet: Sheet, record: Files, *, x: Window | None = None, field: str | Sequence[str] | None = None) -> None:
    """Draw the arrival of the rupture and its local speed along the interface, with the wave speeds.

    The speed is the slope of a least-squares line through the arrivals in a window of 5 % of the interface, or of five
    points where that is more; a window with fronts in both directions, as around an inner origin, has none. A panel
    without a speed states why. Fronts far slower than waves are drawn without wave speeds. Where most points that slide
    have no neighbours that do, as contacts of rough surfaces, there is no front: neither lines nor a speed are drawn.

    Parameters
    ----------
    field
        Panels: "rupture_time", "rupture_speed". Default: both.
    """
    whole = record.interface
    data = at_positions(whole, x, sheet.name)
    position, arrival = data["position"].values, _arrival(record, data)
    wanted = sheet.choose(field, PANELS)
    panels = dict(zip(wanted, sheet.panels(1, len(wanted), 2.6, sharex=True)[0], strict=True))
    x_size, x_unit = sheet.scale("x", np.ptp(position), "m")
    for ax in panels.values():
        ax.set(xlabel=along(record, x_size, x_unit), xlim=(position[0] / x_size, position[-1] / x_size))
    if "rupture_time" in panels:
        ax = panels["rupture_time"]
        t_size, t_unit = sheet.scale("time", end_time(record), "s")
        style = "." if _is_scattered(arrival) else ".-"
        ax.plot(position / x_size, arrival / t_size, style, ms=2, color="#1a1a1a")  # a point may stand alone
        ax.set_ylabel(f"Rupture time ({t_unit})")
        if not np.isfinite(arrival).any():
            note(ax, "no sliding")
    marked = "rupture_speed" in panels and _speed(sheet, panels["rupture_speed"], record, data, x_size)
    sheet.letter(panels.values())
    sheet.remark(whose_speeds(record) if marked else "", not_resolved(record))


def _arrival(record: Files, data: Data) -> Array:
    """Return the rupture times within the times of the record [s]; NaN elsewhere."""
    arrival = data["rupture_time"].values
    return np.where((arrival >= record.since) & (arrival <= record.until), arrival, np.nan)


def _speed(sheet: Sheet, ax: Axes, record: Files, data: Data, x_size: float) -> bool:
    """Draw the local speed of the front; return whether wave speeds are drawn."""
    everywhere = record.interface["position"].values
    position, arrival = data["position"].values, _arrival(record, data)
    speeds = guides(record)
    fastest = max((guide.speed for guide in speeds), default=1.0)
    window = max(0.05 * np.ptp(everywhere), 5 * float(np.median(np.diff(everywhere))))
    local = np.abs(local_speed(position, arrival, window))
    local[_both_ways(position, arrival, window)] = np.nan
    scattered = _is_scattered(arrival)
    if scattered:
        local[:] = np.nan
    together = local > 3 * fastest
    local[together] = np.nan
    shown = np.append(local[np.isfinite(local)], 0.0)
    typical = float(np.quantile(shown, 0.9))
    if typical < SLOW * min((guide.speed for guide in speeds), default=0.0):
        speeds = []
    top = 1.35 * max([typical, *(guide.speed for guide in speeds)]) or 1.0
    size, unit = sheet.scale("rupture_speed", top, "m/s")
    if unit == "m/s" and top > 1200 and not sheet.asks("rupture_speed"):
        size, unit = 1e3, "km/s"
    ax.plot(position / x_size, local / size, ".-", ms=2, color="#1a1a1a")
    ax.set(ylabel=f"Rupture speed ({unit})", ylim=(0, top / size))
    heights = spread(np.array([guide.speed for guide in speeds]) / top, ROOM)
    for (name, speed, style), height in zip(speeds, heights, strict=True):
        ax.axhline(speed / size, ls=style, color=GUIDE, lw=0.8)
        ax.annotate(
            name,
            (1, height),
            (3, 0),
            xycoords="axes fraction",
            textcoords="offset points",
            color=GUIDE,
            va="center",
            annotation_clip=False,
        )
    if not np.isfinite(arrival).any():
        note(ax, "no sliding")
    elif scattered:
        note(ax, "no front: single\ncontacts slide")
    elif len(shown) == 1:
        note(ax, "no front: the points\nslide at once" if together.any() else "no speed: fewer than four points\n"
             "of a window slid one after another")  # fmt: skip
    return bool(speeds)


def _is_scattered(arrival: Array) -> bool:
    """Return whether points slide in several places, less than half of them in groups of `CONNECTED` neighbours."""
    slides = np.isfinite(arrival)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], slides, [False]])))
    lengths = ends[1::2] - ends[::2]
    return len(lengths) > 1 and bool(lengths[lengths >= CONNECTED].sum() < 0.5 * slides.sum())


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
    values: Array = np.empty(len(heights))
    values[order] = placed
    return values


def _both_ways(position: Array, arrival: Array, width: float) -> Array:
    """Return the points in whose window at least a tenth of the arrivals run against the others."""
    middle, step = (position[1:] + position[:-1]) / 2, np.diff(arrival)
    first, last = (np.searchsorted(middle, position + shift) for shift in (-width / 2, width / 2))
    later, earlier = (np.append(0, np.cumsum(way)) for way in (step > 0, step < 0))
    later, earlier = later[last] - later[first], earlier[last] - earlier[first]
    both: Array = (later + earlier > 0) & (np.minimum(later, earlier) >= 0.1 * (later + earlier))
    return both
