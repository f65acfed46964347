"""Figure of runs whose time steps span decades: slow loading and ruptures in one picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from ruptfx.figure_style import GUIDE, RATE_MAP, Array, edges, letter, new_figure, remark, scale, styled
from ruptfx.plots._record import along, direction, guides, has_slip_rates, is_uneven, not_resolved, turned, whose_speeds
from ruptfx.record import Files

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


@styled
def cycles(record: Files) -> Figure:
    """Draw shear force, peak slip rate, slip rate along the interface in all phases, and the largest rupture.

    In (c) time is stretched where records are dense, so that every phase is visible.
    """
    data = record.interface
    position, time = data["position"].values, data["time"].values
    rate = np.abs(data["slip_rate"].values)
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(time, "s")
    figure, axes = new_figure(2, 2, 5.6)
    force = direction(record) * np.trapezoid(data["shear_traction"].values, position, axis=1)
    f_size, f_unit = scale(force, "Pa")  # newton per metre, with the same prefixes
    across = "circumference" if record.case.get("plane") == "axisymmetric" else "thickness"
    axes[0, 0].plot(time / t_size, force / f_size, color="#1a1a1a", lw=0.8)
    axes[0, 0].set(xlabel=f"Time ({t_unit})", ylabel=f"Shear force per {across} ({f_unit.replace('Pa', 'N/m')})")
    peak = rate.max(axis=1)
    axes[0, 1].semilogy(time / t_size, np.where(peak > 0, peak, np.nan), color="#c1440e", lw=0.8)
    if peak.min() < SLOWEST < peak.max():
        axes[0, 1].set_ylim(bottom=SLOWEST)
    axes[0, 1].set(xlabel=f"Time ({t_unit})", ylabel="Peak slip rate (m/s)")
    for ax in axes[0]:
        ax.set_xlim(time[0] / t_size, time[-1] / t_size)
    high = float(rate.max(initial=0.0))
    if high <= SLOWEST:
        for ax in axes[1]:
            ax.set_visible(False)
        remark(figure, "No sliding.")
        letter(axes[0])
        return figure
    norm, found = LogNorm(max(SLOWEST, 1e-10 * high), high), ruptures(record)
    places, times = edges(position) / x_size, edges(time) / t_size
    mesh = axes[1, 0].pcolormesh(places, times, np.maximum(rate, norm.vmin or 0), norm=norm, cmap=RATE_MAP,
                                 rasterized=True)  # fmt: skip
    _stretch(axes[1, 0], times, [first for first, _ in found])
    axes[1, 0].set(xlabel=along(record, x_size, x_unit), ylabel=f"Time ({t_unit}), stretched")
    figure.colorbar(mesh, ax=axes[1, 0], label="Magnitude of slip rate (m/s)", extend="min", pad=0.04)
    if found:
        _largest(axes[1, 1], record, found, position / x_size, x_unit, x_size)
    axes[1, 1].set_visible(bool(found))
    dense = "Time in (c) is stretched where records are dense."
    remark(figure, dense, turned(record), whose_speeds(record) if found else "", not_resolved(record))
    letter(ax for ax in axes.ravel() if ax.get_visible())
    return figure


def _stretch(ax: Axes, times: Array, found: list[int]) -> None:
    """Scale the time axis so that every record has the same height, with ticks where ruptures begin."""
    numbers = np.arange(len(times), dtype=float)
    ax.set_yscale("function", functions=(
        lambda time: np.interp(time, times, numbers), lambda number: np.interp(number, numbers, times),
    ))  # fmt: skip
    ticks: list[int] = []
    for number in (0, *found, len(times) - 1):
        if not ticks or number - ticks[-1] > 0.04 * len(times):  # labels have a height
            ticks.append(number)
    ax.set_yticks(times[ticks], [f"{time:.4g}" for time in times[ticks]])
    ax.minorticks_off()
    ax.set_ylim(times[0], times[-1])


def _largest(
    ax: Axes, record: Files, found: list[tuple[int, int]], position: Array, x_unit: str, x_size: float
) -> None:
    """Draw the rupture with the most slip against the time since its start, with lines at the wave speeds."""
    data = record.interface
    slip = data["slip"].values
    first, last = max(found, key=lambda rows: float(np.abs(slip[rows[1]] - slip[rows[0]]).mean()))
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
    size, unit = scale(time, "s")
    mesh = ax.pcolormesh(edges(position), edges(time) / size, np.maximum(rate, threshold), cmap=RATE_MAP,
                         norm=LogNorm(threshold, max(rate.max(), 2 * threshold)), rasterized=True)  # fmt: skip
    ax.figure.colorbar(mesh, ax=ax, label="Magnitude of slip rate (m/s)", extend="min", pad=0.03)
    from_size, from_unit = scale(start, "s")
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
