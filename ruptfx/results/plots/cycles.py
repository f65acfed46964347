"""Figure of runs whose time steps span decades: slow loading and ruptures in one picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.patheffects import withStroke

from ruptfx.results.figure_style import GUIDE, RATE_MAP, Array, edges
from ruptfx.results.plots._record import (
    along,
    at_positions,
    direction,
    guides,
    has_slip_rates,
    is_uneven,
    not_resolved,
    turned,
    whose_speeds,
)
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Data, Files

PANELS = ("force", "peak_slip_rate", "slip_rate", "largest_rupture")
SLOWEST = 1e-10  # m/s


def suits(record: Files) -> bool:
    """Return whether the run has slow and fast phases."""
    return has_slip_rates(record) and is_uneven(record)


def ruptures(record: Files) -> list[tuple[int, int]]:
    """Return first and last record of every period faster than the rupture threshold.

    Pauses of up to a thousand times the shortest time between records do not end a period.
    """
    data = record.interface
    time, peak = data["time"].values, np.abs(data["slip_rate"].values).max(axis=1)
    fast = np.flatnonzero(peak > data.attrs.get("rupture_threshold", 1e-3))
    if not len(fast):
        return []
    ends = np.flatnonzero(np.diff(time[fast]) > 1000 * np.diff(time).min())
    firsts, lasts = np.append(0, ends + 1), np.append(ends, len(fast) - 1)
    return [(int(fast[i]), int(fast[j])) for i, j in zip(firsts, lasts, strict=True) if j > i]


@figure
def cycles(sheet: Sheet, record: Files, *, x: Window | None = None, field: str | Sequence[str] | None = None) -> None:
    """Draw shear force, peak slip rate, slip rate along the interface in all phases, and the largest rupture.

    The vertical axis of the slip rate has the same height for every record, so that every phase is visible. The panel
    of the largest rupture is left out where nothing ruptures, and panels of slip rates where nothing slides.

    Parameters
    ----------
    x
        First and last position [m] of the panels with a slip rate; the force is that of the whole interface.
    field
        Panels: "force", "peak_slip_rate", "slip_rate", "largest_rupture". Default: all.
    """
    data = at_positions(record.interface, x, sheet.name)
    position, time = data["position"].values, data["time"].values
    rate = np.abs(data["slip_rate"].values)
    high, result = float(rate.max(initial=0.0)), ruptures(record)
    filled = PANELS if result else PANELS[:-1]
    wanted = sheet.choose(field, filled if high > SLOWEST else ("force",))
    rows, columns = -(-len(wanted) // 2), min(len(wanted), 2)
    axes = sheet.panels(rows, columns, 2.8 * rows).ravel()
    for ax in axes[len(wanted) :]:
        ax.set_visible(False)
    panels = dict(zip(wanted, axes, strict=False))
    (x_size, x_unit), (t_size, t_unit) = sheet.scale("x", np.ptp(position), "m"), sheet.scale("time", time, "s")
    if "force" in panels:
        whole = record.interface
        force = direction(record) * np.trapezoid(whole["shear_traction"].values, whole["position"].values, axis=1)
        f_size, f_unit = sheet.scale("force", force, "N/m")
        across = "circumference" if record.case.get("plane") == "axisymmetric" else "thickness"
        panels["force"].plot(time / t_size, force / f_size, color="#1a1a1a", lw=0.8)
        panels["force"].set_ylabel(f"Shear force per {across} ({f_unit})")
    if "peak_slip_rate" in panels:
        peak = rate.max(axis=1)
        panels["peak_slip_rate"].semilogy(time / t_size, np.where(peak > 0, peak, np.nan), color="#c1440e", lw=0.8)
        if peak.min() < SLOWEST < peak.max():
            panels["peak_slip_rate"].set_ylim(bottom=SLOWEST)
        panels["peak_slip_rate"].set_ylabel("Peak slip rate (m/s)")
    for name in panels.keys() & {"force", "peak_slip_rate"}:
        panels[name].set(xlim=(time[0] / t_size, time[-1] / t_size), xlabel=f"Time ({t_unit})")
    sheet.letter(panels.values())
    if high <= SLOWEST:
        sheet.remark("No sliding.")
        return
    dense = ""
    if "slip_rate" in panels:
        ax, norm = panels["slip_rate"], LogNorm(max(SLOWEST, 1e-10 * high), high)
        places, times = edges(position) / x_size, edges(time) / t_size
        mesh = ax.pcolormesh(places, times, np.maximum(rate, norm.vmin or 0), norm=norm, cmap=RATE_MAP, rasterized=True)
        _stretch(ax, times, [first for first, _ in result])
        ax.set(xlabel=along(record, x_size, x_unit), ylabel=f"Time ({t_unit}), by record")
        sheet.figure.colorbar(mesh, ax=ax, label="Magnitude of slip rate (m/s)", extend="min", pad=0.04)
        where = f" in ({chr(97 + wanted.index('slip_rate'))})" if len(wanted) > 1 else ""
        dense = f"Every record has the same height{where}."
    if "largest_rupture" in panels:
        _largest(sheet, panels["largest_rupture"], record, result, data, x_unit, x_size)
    speeds = whose_speeds(record) if "largest_rupture" in panels else ""
    sheet.remark(dense, turned(record), speeds, not_resolved(record))


def _stretch(ax: Axes, times: Array, items: list[int]) -> None:
    """Scale the time axis so that every record has the same height, with ticks where ruptures begin."""
    numbers = np.arange(len(times), dtype=float)
    ax.set_yscale("function", functions=(
        lambda time: np.interp(time, times, numbers), lambda number: np.interp(number, numbers, times),
    ))  # fmt: skip
    ticks: list[int] = []
    for number in (0, *items, len(times) - 1):
        if not ticks or number - ticks[-1] > 0.04 * len(times):  # labels have a height
            ticks.append(number)
    ax.set_yticks(times[ticks], [f"{time:.4g}" for time in times[ticks]])
    ax.minorticks_off()
    ax.set_ylim(times[0], times[-1])


def _largest(
    sheet: Sheet, ax: Axes, record: Files, items: list[tuple[int, int]], data: Data, x_unit: str, x_size: float
) -> None:
    """Draw the rupture with the most slip against the time since its start, with lines at the wave speeds."""
    position, slip = data["position"].values / x_size, data["slip"].values
    first, last = max(items, key=lambda rows: float(np.abs(slip[rows[1]] - slip[rows[0]]).mean()))
    threshold = data.attrs.get("rupture_threshold", 1e-3)
    rate, time = np.abs(data["slip_rate"].values[first : last + 1]), data["time"].values[first : last + 1]
    # Centre the passage of the front: nucleation comes before it, ringing after it.
    ahead = rate > max(threshold, 0.02 * rate.max())
    reached = ahead.argmax(axis=0)[ahead.any(axis=0)]
    began, crossed = time[reached.min()], time[reached.max()]
    around = max(0.5 * (crossed - began), 10 * float(np.diff(time).min()))  # a stiff block slips as one
    shown = (time >= began - around) & (time <= crossed + around)
    rate, start = rate[shown], time[shown][0]
    time = time[shown] - start
    size, unit = sheet.scale("rupture_time", time, "s")
    mesh = ax.pcolormesh(edges(position), edges(time) / size, np.maximum(rate, threshold), cmap=RATE_MAP,
                         norm=LogNorm(threshold, max(rate.max(), 2 * threshold)), rasterized=True)  # fmt: skip
    sheet.figure.colorbar(mesh, ax=ax, label="Magnitude of slip rate (m/s)", extend="min", pad=0.03)
    from_size, from_unit = sheet.scale("time", start, "s")
    since = f"Time since {start / from_size:.5g} {from_unit} ({unit})"
    ax.set(xlabel=along(record, x_size, x_unit), ylabel=since, ylim=(0, max(time[-1], 1e-300) / size))
    width, low = np.ptp(position), 0.04 * time[-1] / size
    halo = [withStroke(linewidth=1.5, foreground="white")]
    for wanted, place in (("c_s", 0.62), ("c_p", 0.8)):  # slopes to compare with
        for name, speed, style in guides(record, wanted):
            x = position[0] + np.array([place, place + 0.14]) * width
            rise = 0.14 * width * x_size / speed / size
            ax.plot(x, [low, low + rise], style, color=GUIDE, lw=0.8, path_effects=halo)
            ax.annotate(name, (x[1], low + rise), (2, 0), textcoords="offset points", color=GUIDE, va="center",
                        path_effects=halo)  # fmt: skip
