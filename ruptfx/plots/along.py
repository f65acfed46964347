"""Figures along the interface: slip rate in space and time, snapshots, slip profiles, speed of the front."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from ruptfx.analysis import rupture_origin
from ruptfx.analysis.front import local_speed
from ruptfx.analysis.modes import LEVEL
from ruptfx.plots.style import (
    GUIDE,
    RATE_MAP,
    TIME_MAP,
    WIDTH,
    Array,
    along,
    default_times,
    direction,
    edges,
    end_time,
    guides,
    letter,
    nearest,
    new_figure,
    note,
    remark,
    scale,
    styled,
    turned,
    whose_speeds,
)
from ruptfx.record import Record


@styled
def space_time(record: Record) -> Figure:
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
    peak = rate.max(initial=0.0)
    if peak > 0 and len(time) > 1:
        low, high, logarithmic = _range(record, rate)
        size, unit = scale(high, "m/s")
        norm = (LogNorm if logarithmic else Normalize)(low / size, max(high, 2 * low) / size)
        shown = np.ma.masked_less(rate, low) / size
        grid = edges(position) / x_size, edges(time) / t_size
        colours = RATE_MAP.with_extremes(under="white")
        mesh = ax.pcolormesh(*grid, shown, norm=norm, cmap=colours, rasterized=True)
        bar = figure.colorbar(mesh, ax=ax, label=f"Magnitude of slip rate ({unit})", extend="both", pad=0.03)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.yaxis.set_minor_formatter("")
    if peak <= LEVEL * data.attrs.get("V_imp", 0):
        note(ax, "no sliding")
    _rays(ax, record, x_size, t_size)
    remark(figure, whose_speeds(record))
    return figure


def _range(record: Record, rate: Array) -> tuple[float, float, bool]:
    """Sliding threshold, largest slip rate but for a thousandth, and whether pulses call for a logarithmic scale."""
    low = LEVEL * (record.interface.attrs.get("V_imp") or rate.max())
    sliding = rate[rate > low]
    middle, high = np.quantile(sliding, [0.5, 0.999]) if len(sliding) else (low, rate.max())
    return float(low), float(high), bool(high > 10 * middle)


def _rays(ax: Axes, record: Record, x_size: float, t_size: float) -> None:
    """Lines x = x_0 +- c (t - t_0), to both sides of an inner origin, labelled where they leave the picture."""
    start, begin = (value / size for value, size in zip(rupture_origin(record), (x_size, t_size), strict=True))
    (left, right), top = ax.get_xlim(), ax.get_ylim()[1]
    halo = [withStroke(linewidth=1.5, foreground="white")]
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
            ax.annotate(
                name, end, (3, 0) if at_side else (0, 3), textcoords="offset points", color=GUIDE,
                ha="right" if leans_left else "left", va="center" if at_side else "bottom",
                annotation_clip=False, path_effects=halo,
            )


@styled
def snapshots(record: Record, times: Sequence[float] | None = None) -> Figure:
    """Slip rate, shear traction and normal stress along the interface at several times, one row each.

    Thin vertical lines show how far c_s and c_l reach from the loaded end. Slip rate and shear traction are positive
    in the direction of the slip; where that turns their sign the figure says so. Slip rates have a logarithmic axis
    where narrow pulses ask for it.

    Parameters
    ----------
    record : Record
    times : sequence of float, optional
        Times [s]; the nearest saved ones are drawn. Default: four while the rupture runs.
    """
    data = record.interface
    saved = data["time"].values
    rows = default_times(record, saved, 4) if times is None else nearest(saved, np.asarray(times))
    if not len(rows):
        return _empty("no time was saved")
    position, sign = data["position"].values, direction(record)
    x_size, x_unit = scale(np.ptp(position), "m")
    names = {"slip_rate": ("Slip rate", "m/s"), "shear_traction": ("Shear traction", "Pa"),
             "normal_stress": ("Normal stress", "Pa")}
    figure, axes = new_figure(len(rows), 3, 0.6 + 1.25 * len(rows), sharex=True, sharey="col")
    axes[0, 0].set_xlim(position[0] / x_size, position[-1] / x_size)
    for column, (name, (title, unit)) in enumerate(names.items()):
        values = data[name].isel(time=rows).values * (1.0 if name == "normal_stress" else sign)
        size, printed = scale(values, unit)
        for ax, row, line in zip(axes[:, column], rows, values / size, strict=True):
            if name == "slip_rate":
                ax.fill_between(position / x_size, line, color="#c1440e", alpha=0.25, lw=0)
            ax.plot(position / x_size, line, color=("#c1440e", "#1a1a1a", "#3a7d44")[column])
            ax.set_ylabel(f"{title} ({printed})")
            _marks(ax, record, saved[row], x_size, named=column > 0)
        middle, largest = values.mean() / size, np.abs(values).max() / size
        if np.ptp(values) / size < 0.01 * largest:  # show rounding as what it is
            axes[0, column].set_ylim(middle - 0.05 * largest, middle + 0.05 * largest)
        low, _, logarithmic = _range(record, np.abs(values))
        if name == "slip_rate" and logarithmic:
            axes[0, 0].set_yscale("log", nonpositive="clip")
            axes[0, 0].set_ylim(low / size, 2 * values.max() / size)
        axes[-1, column].set_xlabel(along(record, x_size, x_unit))
    t_size, t_unit = scale(saved, "s")
    for ax, row in zip(axes[:, 0], rows, strict=True):
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
    remark(figure, turned(record), whose_speeds(record))
    letter(axes.ravel())
    return figure


def _marks(ax: Axes, record: Record, time: float, x_size: float, named: bool) -> None:
    start, begin = rupture_origin(record)
    left, right = ax.get_xlim()
    labelled = left + 0.1 * (right - left)  # keeps labels clear of the panel letter and of each other
    for sign in (-1, 1):
        for name, speed, style in guides(record, "c_s", "c_p"):
            place = (start + sign * speed * (time - begin)) / x_size
            if not (time > begin and left < place < right):
                continue
            ax.axvline(place, color=GUIDE, lw=0.5, ls=style, zorder=0)
            if named and place > labelled + 0.08 * (right - left):
                labelled = place
                ax.annotate(name, (place, 1), (0, 1), xycoords=("data", "axes fraction"), color=GUIDE,
                            textcoords="offset points", ha="center", va="bottom", annotation_clip=False)


@styled
def slip_profiles(record: Record, times: Sequence[float] | None = None) -> Figure:
    """Total slip and displacement jump along the interface at successive times, coloured by time.

    The jump contains the elastic stretch of a compliant interface, the slip does not. Both are positive in
    the direction of the slip; where that turns their sign the figure says so.

    Parameters
    ----------
    record : Record
    times : sequence of float, optional
        Times [s]; the nearest saved ones are drawn. Default: twelve over the run.
    """
    data = record.interface
    saved = data["time"].values
    if not len(saved):
        return _empty("no time was saved")
    wanted = np.linspace(saved[0], saved[-1], 13)[1:] if times is None else np.asarray(times)
    rows = np.unique(nearest(saved, wanted))
    position, sign = data["position"].values, direction(record)
    until = end_time(record)
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(until, "s")
    names = {"slip": "Slip", "displacement_jump": "Displacement jump"}
    values = {name: sign * data[name].isel(time=rows).values for name in names if name in data}
    size, unit = scale(np.array(list(values.values())), "m")
    figure, axes = new_figure(1, len(values), 2.6, sharex=True, sharey=True)
    colours = ScalarMappable(Normalize(0, until / t_size), TIME_MAP)
    for ax, (name, lines) in zip(axes[0], values.items(), strict=True):
        for row, line in zip(rows, lines, strict=True):
            ax.plot(position / x_size, line / size, color=colours.to_rgba(saved[row] / t_size))
        ax.set(xlabel=along(record, x_size, x_unit), ylabel=f"{names[name]} ({unit})")
        ax.set_xlim(position[0] / x_size, position[-1] / x_size)
    figure.colorbar(colours, ax=axes[0].tolist(), label=f"Time ({t_unit})")
    remark(figure, turned(record))
    letter(axes[0])
    return figure


@styled
def front(record: Record) -> Figure:
    """Arrival of the rupture and its local speed along the interface, with the wave speeds.

    The speed is the slope of a least-squares line through the arrivals in a window of 5 % of the interface; a window
    with fronts in both directions, as around an inner origin, has none. A panel without a speed says why.
    """
    data = record.interface
    position, arrival = data["position"].values, data["rupture_time"].values
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(end_time(record), "s")
    figure, (axes,) = new_figure(1, 2, 2.6, sharex=True)
    axes[0].plot(position / x_size, arrival / t_size, color="#1a1a1a")
    axes[0].set(xlabel=along(record, x_size, x_unit), ylabel=f"Rupture time ({t_unit})")
    axes[0].set_xlim(position[0] / x_size, position[-1] / x_size)
    speeds = guides(record)
    fastest = max((guide.speed for guide in speeds), default=1.0)
    size, unit = (1e3, "km/s") if fastest > 900 else scale(fastest, "m/s")
    local = np.abs(local_speed(position, arrival, 0.05 * np.ptp(position)))
    local[_both_ways(position, arrival, 0.05 * np.ptp(position))] = np.nan
    together = local > 3 * fastest
    local[together] = np.nan
    shown = np.append(local[np.isfinite(local)], 0.0)
    axes[1].plot(position / x_size, local / size, ".-", ms=2, color="#1a1a1a")  # a point may stand alone
    for name, speed, style in speeds:
        axes[1].axhline(speed / size, ls=style, color=GUIDE, lw=0.8)
        axes[1].annotate(
            name, (1, speed / size), (3, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
            color=GUIDE, va={"$c_s$": "bottom", "$c_R$": "top"}.get(name, "center"), annotation_clip=False,
        )
    axes[1].set(
        xlabel=along(record, x_size, x_unit), ylabel=f"Rupture speed ({unit})",
        ylim=(0, 1.35 * max(fastest, np.quantile(shown, 0.9)) / size),
    )
    if not np.isfinite(arrival).any():
        for ax in axes:
            note(ax, "no sliding")
    elif len(shown) == 1:
        note(axes[1], "no front: the points\nslide at once" if together.any() else "too few points slid\nfor a speed")
    remark(figure, whose_speeds(record))
    letter(axes)
    return figure


def _both_ways(position: Array, arrival: Array, width: float) -> Array:
    """Points about which, in a window, at least a tenth of the arrivals run against the others."""
    middle, step = (position[1:] + position[:-1]) / 2, np.diff(arrival)
    first, last = (np.searchsorted(middle, position + shift) for shift in (-width / 2, width / 2))
    later, earlier = (np.append(0, np.cumsum(way)) for way in (step > 0, step < 0))
    later, earlier = later[last] - later[first], earlier[last] - earlier[first]
    return (later + earlier > 0) & (np.minimum(later, earlier) >= 0.1 * (later + earlier))


def _empty(text: str) -> Figure:
    figure, axes = new_figure(1, 1, 2.0, WIDTH / 2)
    axes[0, 0].set(xlabel="Position along the interface (m)", ylabel="Time (s)")
    note(axes[0, 0], text)
    return figure


