"""Figure of the slip rate in space and time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator

from ruptfx.results.analysis import SLIDING, nucleation, rupture_origin, slides_far
from ruptfx.results.analysis.modes import LEVEL
from ruptfx.results.figure_style import GUIDE, RATE_MAP, TIME_MAP, Array, edges, note
from ruptfx.results.plots._record import (
    along,
    at_positions,
    end_time,
    guides,
    has_origin,
    is_quasi_static,
    is_uneven,
    not_resolved,
    open_faces,
    quantity,
    rate_range,
    signed,
    slid,
    turned,
    whose_speeds,
)
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.plots._states import COLOURS
from ruptfx.results.record import Data, Files

WIDE, HIGH = 0.09, 0.05  # width and height of a label over those of the picture


def suits(record: Files) -> bool:
    """Return whether the run slipped and has evenly saved times."""
    return slid(record) and not is_uneven(record)


@figure
def space_time(sheet: Sheet, record: Files, *, x: Window | None = None, field: str = "slip_rate") -> None:
    """Draw the slip rate against position and time, with lines from the loaded end at the wave speeds.

    White is slower than the sliding threshold (2 % of the driven speed); in finite sliding, white points stick.
    Grey points are open and have no slip rate. Colours are logarithmic where narrow pulses are ten times
    faster than the other points. Wave speeds that coincide in the picture are not drawn.

    Parameters
    ----------
    field : str
        A field of the interface with a value at every time, such as "slip", "shear_traction", "normal_stress",
        "opening", or a state of the friction law.
    """
    data = at_positions(record.interface, x, sheet.name)
    position, time = data["position"].values, data["time"].values
    until, (since, _) = end_time(record), nucleation(data)
    (x_size, x_unit), (t_size, t_unit) = sheet.scale("x", np.ptp(position), "m"), sheet.scale("time", until, "s")
    quantity(data, field, sheet.name)  # refuses unknown fields before anything is drawn
    ax = sheet.panels(1, 1, 3.6, 4.8)[0, 0]
    ax.set(
        xlabel=along(record, x_size, x_unit),
        ylabel=f"Time ({t_unit})",
        xlim=(position[0] / x_size, position[-1] / x_size),
        ylim=(record.since / t_size, until / t_size),
    )
    if record.since < since < until:  # loaded first
        ax.set_ylim(bottom=max(record.since, since - 0.1 * (until - since)) / t_size)
    grid = edges(position) / x_size, edges(time) / t_size
    said = ""
    if field == "slip_rate":
        said = _rate(sheet, ax, data, grid)
    elif len(time) > 1:
        said = _field(sheet, ax, record, data, field, grid)
    drawn = has_origin(record) and not is_quasi_static(record) and _rays(ax, record, x_size, t_size)
    sheet.remark(said, whose_speeds(record) if drawn else "", not_resolved(record))


def _rate(sheet: Sheet, ax: Axes, data: Data, grid: tuple[Array, Array]) -> str:
    """Draw the slip rate; return what its white and grey points are."""
    rate = np.abs(data["slip_rate"].values)
    states = data["contact"].values if slides_far(data) else None
    away = open_faces(data)
    rate = np.where(away if states is None else states != SLIDING, 0.0, rate)
    peak = float(rate.max(initial=0.0))
    if peak <= LEVEL * data.attrs.get("V_imp", 0):
        note(ax, "no sliding")
    if peak == 0 or len(rate) < 2:
        return ""
    low, high, logarithmic = rate_range(data, rate)
    size, unit = sheet.scale("slip_rate", high, "m/s")
    norm = (LogNorm if logarithmic else Normalize)(low / size, max(high, 2 * low) / size)
    if states is None:
        shown, white = np.ma.masked_less(rate, low), "slower than {}, which does not count as sliding"
    else:
        shown, white = np.ma.masked_where(states != SLIDING, rate), "sticks, or slides slower than {}"
    white = f"White: {white.format(f'{low / size:.3g} {unit}')}."
    if away.any():
        grey = ListedColormap([COLOURS["open"]])
        ax.pcolormesh(*grid, np.ma.masked_where(~away, np.ones_like(rate)), cmap=grey, rasterized=True)
        white += " Grey: open faces."
    colours = RATE_MAP.with_extremes(under="white")
    mesh = ax.pcolormesh(*grid, shown / size, norm=norm, cmap=colours, rasterized=True)
    # Less than two decades need numbers between their powers of ten.
    ticks = LogLocator(subs=(1, 2, 5)) if logarithmic and high < 100 * low else None
    label = f"Magnitude of slip rate ({unit})"
    bar = sheet.figure.colorbar(mesh, ax=ax, label=label, ticks=ticks, extend="both", pad=0.03)
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.yaxis.set_minor_formatter("")
    return white


def _field(sheet: Sheet, ax: Axes, record: Files, data: Data, name: str, grid: tuple[Array, Array]) -> str:
    """Draw a field other than the slip rate; return whether its sign is turned, as a sentence."""
    meant = quantity(data, name, sheet.name)
    values = signed(record, name) * data[name].values
    size, unit = sheet.scale(name, values, meant.unit)
    low, high = np.nanquantile(values, [0.001, 0.999])
    extend = ("min" if np.nanmin(values) < low else "") + ("max" if np.nanmax(values) > high else "")
    norm = Normalize(low / size, high / size if high > low else low / size + 1.0)
    mesh = ax.pcolormesh(*grid, values / size, norm=norm, cmap=TIME_MAP, rasterized=True)
    label = meant.label if unit == "1" else f"{meant.label} ({unit})"
    sheet.figure.colorbar(
        mesh, ax=ax, label=label, pad=0.03, extend={"": "neither", "minmax": "both"}.get(extend, extend)
    )
    return turned(record) if signed(record, name) < 0 else ""


def _rays(ax: Axes, record: Files, x_size: float, t_size: float) -> bool:
    """Draw labelled lines x = x_0 +- c (t - t_0), to both sides of an inner origin; return whether there are any.

    Lines without room for their label are left out, and all lines if they coincide.
    """
    start, begin = (value / size for value, size in zip(rupture_origin(record), (x_size, t_size), strict=True))
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    sides = [(sign, room) for sign, room in ((1, right - start), (-1, start - left)) if room >= 0.02 * (right - left)]
    speeds = guides(record)
    if not sides or not speeds:
        return False
    slowest = min(speed for _, speed, _ in speeds) * t_size / x_size
    if max(room for _, room in sides) / slowest < HIGH * (top - bottom):
        return False
    halo = [withStroke(linewidth=1.5, foreground="white")]
    labelled: list[tuple[float, float]] = []  # positions of labels, as fractions of the picture
    for name, speed, style in speeds:
        slope = speed * t_size / x_size
        ends, at_side, at_left = [], [], []
        for sign, room in sides:
            reach = min(room, slope * (top - begin))
            ends.append((start + sign * reach, begin + reach / slope))
            at_side.append(reach >= room)
            # c_R and c_s are close: above the picture their labels lean away from each other.
            at_left.append(reach < room and (name == "$c_R$") == (sign > 0))
        end, beside, leans_left = ends[0], at_side[0], at_left[0]  # labels at one side are enough
        place = (end[0] - left) / (right - left), (end[1] - bottom) / (top - bottom)
        if not leans_left:
            if any(abs(x - place[0]) < WIDE and abs(y - place[1]) < HIGH for x, y in labelled):
                continue
            labelled.append(place)
        for x, y in ends:
            ax.plot([start, x], [begin, y], style, color=GUIDE, lw=0.8, gid="ray", path_effects=halo)
        ax.annotate(
            name, end, (3, 0) if beside else (0, 3), textcoords="offset points", color=GUIDE,
            ha="right" if leans_left else "left", va="center" if beside else "bottom",
            annotation_clip=False, path_effects=halo,
        )  # fmt: skip
    return True
