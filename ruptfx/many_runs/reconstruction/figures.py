"""Figures of a reconstruction: data and fit, slip rate with the front, traction and friction, information."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from ruptfx.many_runs.reconstruction.result import KNOWN
from ruptfx.results.figure_style import (
    GUIDE,
    MUTED,
    RATE_MAP,
    STICK_SLIP,
    TIME_MAP,
    blank_figure,
    edges,
    known_unit,
    letter,
    new_figure,
    remark,
    scale,
    styled,
)
from ruptfx.results.plots import surface_maps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ruptfx.many_runs.reconstruction.experiment import Channel
    from ruptfx.many_runs.reconstruction.result import Reconstruction, Surface

Floats = NDArray[np.float64]
MOST = 24
"""Largest number of channels in the figure of data and fit."""
FRONT = 0.2
"""Part of the peak slip rate whose passage is the front."""
SURE = 3.0
BARS = 12
"""Number of error bars of a curve."""


@styled
def draw_fit(made: Reconstruction) -> Figure:
    """Return the figure of data and fit of every channel, with residuals over sigma."""
    traces = [pair for pair in zip(made.channels, made.fits, strict=True) if len(pair[0].times) > 1]
    shown = traces[:: -(-len(traces) // MOST)] if traces else []
    columns = 2 if len(shown) > 6 else 1
    rows = max(-(-len(shown) // columns), 1)
    figure = blank_figure(7.0, min(0.9 * rows + 0.9, 9.0))
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True)
    size, unit = scale(made.times, "s")
    for ax, (channel, fit) in zip(axes.T.ravel(), shown, strict=False):
        _draw_channel(ax, channel, fit, size)
    for ax in axes.T.ravel()[len(shown) :]:
        ax.set_axis_off()
    for ax in axes[-1]:
        ax.set_xlabel(f"Time ({unit})")
    if shown:
        axes[0, 0].legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98), borderaxespad=0.1)
    left = f"{len(shown)} of {len(traces)} channels. " if len(shown) < len(traces) else ""
    remark(figure, f"{left}Numbers: mean square of the residuals over that of noise. Grey: 95 % of noise.")
    return figure


def _draw_channel(ax: Axes, channel: Channel, fit: Floats, size: float) -> None:
    values, unit = _scaled(channel.unit, np.abs(channel.values).max())
    x = channel.times / size
    ax.fill_between(x, (fit - 2 * channel.sigma) / values, (fit + 2 * channel.sigma) / values, color=MUTED, alpha=0.3,
                    lw=0, label="fit ± 2 sigma")  # fmt: skip
    ax.plot(x, channel.values / values, ".", color="k", ms=1.5, label="data")
    ax.plot(x, fit / values, color=STICK_SLIP, lw=0.8, label="fit")
    ax.set_ylabel(unit, fontsize=6)
    misfit = float(np.mean(((channel.values - fit) / channel.sigma) ** 2))
    ax.text(0.01, 0.95, f"{channel.name}: {misfit:.2f}", transform=ax.transAxes, va="top", fontsize=6)
    ax.margins(y=0.25)


def _scaled(unit: str, largest: float) -> tuple[float, str]:
    """Return size and name of a unit; numbers of strains are microstrains."""
    if known_unit(unit):
        return scale(largest, unit)
    return (1e-6, "10$^{-6}$") if unit == "1" and largest < 1e-2 else (1.0, "" if unit == "1" else unit)


@styled
def draw_slip_rate(made: Reconstruction) -> Figure:
    """Return the figure of the mean slip rate over position and time with its front, and of its deviation.

    Those of a surface are maps at some times.
    """
    if made.surface is not None:
        return _slip_rate_maps(made, made.surface)
    figure, ((left, right),) = new_figure(1, 2, 3.2, sharey=True)
    x, t, grid, order = _grid(made)
    size, unit = scale(max(float(np.abs(made.mean).max()), 1e-300), "m/s")
    largest = float(np.abs(made.mean).max()) / size or 1.0
    for ax, values, text in (
        (left, np.abs(made.mean), "Magnitude of slip rate"), (right, made.deviation, "Standard deviation"),
    ):  # fmt: skip
        mesh = ax.pcolormesh(*grid, values[:, order] / size, cmap=RATE_MAP, vmin=0, vmax=largest, rasterized=True)
        figure.colorbar(mesh, ax=ax, label=f"{text} ({unit})", location="top", shrink=0.9)
    place, when = front(made)
    left.plot(place / x[1], when / t[1], ".", color=GUIDE, ms=2, label=f"front, {100 * FRONT:g} % of the peak")
    if len(place):
        left.legend(loc="upper left", frameon=True, framealpha=0.8, edgecolor="none")
    _label(made, (left, right), x[2], t[2])
    remark(figure, "The front is drawn where the data remove more than half of the prior variance.")
    return figure


def _slip_rate_maps(made: Reconstruction, surface: Surface) -> Figure:
    knots, sizes = surface.knots(made.times, np.abs(made.mean).max(axis=1)), np.linalg.norm(surface.mean, axis=0)
    size, unit = scale(max(float(sizes.max()), 1e-300), "m/s")
    t_size, t_unit = scale(made.times, "s")
    norm, data = Normalize(0, float(sizes.max()) / size or 1.0), made.dataset()
    height, wide = surface_maps.height_in_line([data, data]), surface_maps.axis_scale(data)
    stretch = surface_maps.stretch_of(height)
    tall = min(1.0 + len(knots) * (0.3 + stretch * height), 9.0)
    figure, axes = new_figure(len(knots), 2, tall, sharex=True, sharey=True)
    for row, knot in enumerate(knots):
        for ax, values in zip(axes[row], (sizes[knot], made.deviation[knot]), strict=True):
            drawn = surface_maps.draw(ax, data, values / size, norm, RATE_MAP, wide, stretch)
            surface_maps.label(ax, data, ax is axes[row, 0], knot == knots[-1], wide)
        axes[row, 0].set_title(f"{made.times[knot] / t_size:.3g} {t_unit}", loc="right")
    axes[0, 0].set_title("Magnitude of slip rate", loc="left")
    axes[0, 1].set_title("Standard deviation", loc="left")
    figure.colorbar(drawn, ax=axes.ravel().tolist(), label=f"Slip rate ({unit})", shrink=0.7)
    remark(figure, "The deviation is that in the direction of the initial shear stress.",
           surface_maps.stretched(stretch))  # fmt: skip
    return figure


def front(made: Reconstruction) -> tuple[Floats, Floats]:
    """Return positions and times at which the slip rate rises through a part of its peak, where it is known.

    Of the times it is the last one before the largest mean slip rate of the position, which is a front where it is
    `SURE` standard deviations from zero.
    """
    sizes, points = np.abs(made.mean), np.arange(len(made.position))
    top = np.argmax(sizes, axis=0)
    slow = (sizes < FRONT * made.peak[0]) & (np.arange(len(sizes))[:, None] < top)
    last = np.where(slow.any(axis=0), len(sizes) - 1 - np.argmax(slow[::-1], axis=0), 0)
    shown = (sizes[top, points] >= np.maximum(SURE * made.deviation[top, points], FRONT * made.peak[0])) & (
        made.information[top, points] >= KNOWN
    )
    return made.position[shown], made.times[last[shown]]


@styled
def draw_friction(made: Reconstruction) -> Figure:
    """Return the figure of traction and friction against slip at the positions of the curves, with bars of 68 %."""
    places, curves = made.places, made.curves
    figure, axes = new_figure(2, len(places), 4.0, sharex="col", sharey="row")
    slip_size, slip_unit = scale(max(float(np.abs(curves.slip[0][:, places]).max()), 1e-300), "m")
    size, unit = scale(float(np.abs(curves.shear_traction[0][:, places]).max()), "Pa")
    for column, place in enumerate(places):
        slip = np.abs(curves.slip[0, :, place]) / slip_size
        path = np.cumsum(np.abs(np.diff(slip, prepend=0.0)))
        bars = np.unique(np.searchsorted(path, np.linspace(0, path[-1], BARS)).clip(0, len(slip) - 1))
        for ax, values, scaled in (
            (axes[0, column], np.abs(curves.shear_traction), size), (axes[1, column], curves.friction, 1.0),
        ):  # fmt: skip
            mean, deviation = values[0, :, place] / scaled, curves.deviation(values)[:, place] / scaled
            across = made.slip_deviation[bars, place] / slip_size
            ax.errorbar(slip[bars], mean[bars], deviation[bars], across, fmt="none",
                        ecolor=STICK_SLIP, elinewidth=0.6, alpha=0.6, label="intervals of 68 %")  # fmt: skip
            ax.plot(slip, mean, color=STICK_SLIP, label="mean")
        if made.law is not None and place in made.law.points:
            fitted = made.law.friction[:, int(np.flatnonzero(made.law.points == place)[0])]
            axes[1, column].plot(slip, fitted, color=GUIDE, ls="--",
                                 label=f"{made.law.kind}, fitted, while it slides")  # fmt: skip
        axes[0, column].set_title(f"at {made.place(place)}", fontsize=7)
        axes[1, column].set_xlabel(f"Slip ({slip_unit})")
    axes[0, 0].set_ylabel(f"Shear traction ({unit})")
    axes[1, 0].set_ylabel("Friction")
    letter(axes[:, 0])
    lines = {text: line for ax in axes.ravel() for line, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(list(lines.values()), list(lines), loc="outside upper right", ncols=len(lines))
    remark(figure, "Friction is shear traction over normal stress.")
    return figure


@styled
def draw_information(made: Reconstruction) -> Figure:
    """Return the map of the prior variance that the data remove, and its mean along the interface.

    On a surface it is the map of the mean over time.
    """
    if made.surface is not None:
        return _information_map(made)
    figure, (top, below) = new_figure(2, 1, 4.0, 4.8, sharex=True, height_ratios=(1, 3))
    x, t, grid, order = _grid(made)
    top[0].plot(made.position[order] / x[1], made.known[order], color=STICK_SLIP)
    top[0].axhline(KNOWN, color=MUTED, lw=0.6, ls="--")
    top[0].set(ylim=(0, 1), ylabel="Mean over time")
    mesh = below[0].pcolormesh(*grid, made.information[:, order], cmap=TIME_MAP, vmin=0, vmax=1, rasterized=True)
    figure.colorbar(mesh, ax=below[0], label="Part of the prior variance removed", pad=0.03)
    _label(made, (below[0],), x[2], t[2])
    return figure


def _information_map(made: Reconstruction) -> Figure:
    data = made.dataset()
    height, wide = surface_maps.height_in_line([data]), surface_maps.axis_scale(data)
    stretch = surface_maps.stretch_of(height)
    figure, ((ax,),) = new_figure(1, 1, min(1.0 + stretch * height, 6.5))
    drawn = surface_maps.draw(ax, data, made.known, Normalize(0, 1), TIME_MAP, wide, stretch)
    surface_maps.label(ax, data, lengths=wide)
    chosen = np.array(made.places)
    ax.plot(made.position[chosen] / wide[0], data["dip"].values[chosen] / wide[0], "o", color=GUIDE, mfc="none",
            clip_on=False, label="curves of friction")  # fmt: skip
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    figure.colorbar(drawn, ax=ax, label="Part of the prior variance removed, mean over time", shrink=0.8)
    remark(figure, surface_maps.stretched(stretch))
    return figure


def _grid(
    made: Reconstruction,
) -> tuple[tuple[Floats, float, str], tuple[Floats, float, str], tuple[Floats, Floats], NDArray[np.int64]]:
    """Return positions and times with size and name of their units, edges of cells, and the order of the points."""
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(made.position), "m"), scale(made.times, "s")
    order = np.argsort(made.position)
    x, t = made.position[order] / x_size, made.times / t_size
    return (x, x_size, x_unit), (t, t_size, t_unit), (edges(x), edges(t)), order


def _label(made: Reconstruction, axes: tuple[Axes, ...], x_unit: str, t_unit: str) -> None:
    del made
    for ax in axes:
        ax.set_xlabel(f"Position ({x_unit})")
    axes[0].set_ylabel(f"Time ({t_unit})")


FIGURES = {
    "fit": draw_fit, "slip_rate": draw_slip_rate, "friction": draw_friction, "information": draw_information,
}  # fmt: skip
"""Drawing functions by the name of their file."""
