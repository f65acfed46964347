"""Figures of the spring-block chain: loading curve and maps, one front enlarged, displacements, precursor lengths."""

from __future__ import annotations

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ruptfx.lumped.spring_block.events import Breaks, Event, local_speeds
from ruptfx.results.figure_style import ACCENT, ONE_COLUMN, STEADY, STICK_SLIP, WIDTH, blank_figure, letter, styled


def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
    """Draw all figures of a result."""
    drawn = {"onset_of_sliding": maps(dataset), "displacements": displacements(dataset)}
    if dataset.sizes["event"]:
        drawn |= {"precursor_length": lengths(dataset), "fronts": fronts(dataset)}
    return drawn


def _first_large(dataset: xarray.Dataset) -> int:
    """Return the index of the first large event, that of the last event if there is none."""
    large = np.flatnonzero(dataset.event_large.values)
    return int(large[0]) if len(large) else dataset.sizes["event"] - 1


def _breaks(dataset: xarray.Dataset) -> Breaks:
    time, block, count = (dataset[f"break_{name}"].values for name in ("time", "block", "count"))
    return Breaks(time, block, count, dataset.attrs["delay"], dataset.contacts.values)


def _map(  # noqa: PLR0913
    figure: Figure,
    ax: Axes,
    data: xarray.DataArray,
    label: str,
    cmap: str,
    extend: str = "neither",
    vmin: float | None = None,
    vmax: float | None = None,
) -> None:
    time = data.time.values
    image = ax.imshow(
        data.values.T,
        aspect="auto",
        origin="lower",
        cmap=cmap,
        rasterized=True,
        extent=(time[0], time[-1], 0.5, data.sizes["block"] + 0.5),
        vmin=vmin,
        vmax=vmax,
    )
    ax.set_ylabel("Block")
    figure.colorbar(image, ax=ax, label=label, pad=0.01, aspect=12, extend=extend)


@styled
def maps(dataset: xarray.Dataset) -> Figure:
    """Draw loading curve, spring forces in the slider, detached fraction and contact forces against time."""
    figure = blank_figure(WIDTH, 6.6)
    axes = figure.subplots(4, 1, sharex=True)
    axes[0].plot(dataset.time, dataset.force, color="k", linewidth=0.8)
    large = dataset.event_large.values.astype(bool)
    axes[0].plot(dataset.event_start[large], dataset.event_force[large], "v", color=STICK_SLIP, label="large event")
    small = ~large & (dataset.event_drop.values > 0)
    axes[0].plot(
        dataset.event_start[small], dataset.event_force[small], ".", color=STEADY, markersize=3, label="precursor"
    )
    axes[0].set(ylabel="Loading force (N)", ylim=(0, None))
    axes[0].legend(loc="lower right", ncols=2)
    _map(figure, axes[1], -dataset.elastic_force.isel(block=slice(0, -1)), "Compression (N)", "viridis")
    _map(figure, axes[2], 100 * (1 - dataset.attached), "Detached (%)", "magma_r", vmin=0, vmax=100)
    reach = float(np.nanpercentile(np.abs(dataset.contact_force), 99.8)) or 1.0
    _map(figure, axes[3], dataset.contact_force, "Contact force (N)", "RdBu_r", "both", vmin=-reach, vmax=reach)
    axes[3].set(xlabel="Time (s)")
    letter(axes)
    return figure


@styled
def fronts(dataset: xarray.Dataset) -> Figure:
    """Draw the first large event enlarged, with the slope of the chain's wave, and the previous front speeds."""
    figure = blank_figure(WIDTH, 2.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    breaks, index = _breaks(dataset), _first_large(dataset)
    start, speed = float(dataset.event_start[index]), float(dataset.chain_speed)
    blocks = dataset.sizes["block"]
    window = np.linspace(start - 2e-3, start + 14e-3, 1200)
    image = left.imshow(
        [100 * breaks.detached(block, window) for block in range(blocks)],
        aspect="auto",
        origin="lower",
        cmap="magma_r",
        vmin=0,
        vmax=100,
        extent=(-2, 14, 0.5, blocks + 0.5),
        rasterized=True,
    )
    left.plot([-1, -1 + blocks / speed * 1e3], [0.5, blocks], color=STEADY, linewidth=1.2)
    left.annotate(
        "wave of\nthe chain",
        (-1 + 0.55 * blocks / speed * 1e3, 0.55 * blocks),
        xytext=(3, 0),
        textcoords="offset points",
        color=STEADY,
        fontsize=6,
        bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1},
    )
    left.set(xlabel="Time since the first detachment (ms)", ylabel="Block")
    left.set_title("(a)", loc="left")
    figure.colorbar(image, ax=left, label="Detached (%)", pad=0.01)
    times, which = breaks.detachments()
    seen = times <= float(dataset.event_end[index])
    _speeds(right, times[seen], which[seen], dataset, speed)
    return figure


def _speeds(ax: Axes, times: np.ndarray, which: np.ndarray, dataset: xarray.Dataset, speed: float) -> None:
    """Draw a histogram of local front speeds within events, and the speeds of the slow fronts."""
    events = []
    for start, end in zip(dataset.event_start.values, dataset.event_end.values, strict=True):
        inside = (times >= start) & (times <= end)
        blocks, first = np.unique(which[inside], return_index=True)
        events.append(Event(start, end, 0, 0, 0, 0, 0, 0, False, blocks, times[inside][first]))
    fast = local_speeds(events) / speed
    slow = (dataset.slow_front_last_block - dataset.slow_front_first_block) / (
        dataset.slow_front_end - dataset.slow_front_start
    )
    bins = np.geomspace(1e-5, 1e1, 61)
    beyond = int((fast > bins[-1]).sum())  # simultaneous detachments
    ax.hist(fast, bins.tolist(), color=STEADY, label="within events" + (f" (and {beyond} beyond)" if beyond else ""))
    if slow.size:
        ax.plot(
            slow / speed,
            np.full(slow.size, 0.03),
            "d",
            color=ACCENT,
            label="slow fronts",
            transform=ax.get_xaxis_transform(),
        )
    ax.axvline(1, color="0.3", linestyle=":", linewidth=0.8)
    ax.set(xscale="log", xlabel="Front speed / chain speed", ylabel="Front segments")
    ax.set_title("(b)  until the first large event", loc="left")
    ax.legend(loc="upper left")


@styled
def displacements(dataset: xarray.Dataset) -> Figure:
    """Draw displacements of the trailing and the middle block, and the first precursors enlarged."""
    figure = blank_figure(ONE_COLUMN, 2.8)
    ax = figure.subplots()
    middle = dataset.sizes["block"] // 2
    inset = ax.inset_axes((0.12, 0.52, 0.42, 0.38))
    until = float(dataset.event_start[_first_large(dataset)]) if dataset.sizes["event"] else np.inf
    early = dataset.time.values <= until
    for block, colour in ((1, STICK_SLIP), (middle, STEADY)):
        path = dataset.position.sel(block=block) * 1e6
        ax.plot(dataset.time, path, color=colour, label=f"block {block}")
        inset.plot(dataset.time[early], path[early], color=colour)
    inset.tick_params(labelsize=6)
    inset.set_title("before sliding", fontsize=6, loc="left")
    ax.set(xlabel="Time (s)", ylabel="Displacement (µm)")
    ax.legend(loc="lower right")
    return figure


@styled
def lengths(dataset: xarray.Dataset) -> Figure:
    """Draw the length of all precursors against their initial force, with their number and correlation."""
    figure = blank_figure(ONE_COLUMN, 3.0)
    ax = figure.subplots()
    slides, blocks = bool(dataset.event_large.values.any()), dataset.sizes["block"]
    last = _first_large(dataset) if slides else dataset.sizes["event"]
    force, reach = dataset.event_force.values[:last], dataset.event_reach.values[:last] / blocks
    scale = float(dataset.attrs["strength"])
    area = 6 + 60 * dataset.event_drop.values[:last] / max(float(dataset.event_drop.max()), 1e-9)
    ax.scatter(force / scale, reach, area, color=STEADY, label="precursor (area: force drop)", zorder=3)
    if slides:
        ax.plot(float(dataset.event_force[last]) / scale, 1, "v", color=STICK_SLIP, label="first large event")
    slope = float(dataset.length_slope)
    if np.isfinite(slope):
        line = np.array([0, float(dataset.event_force[: last + 1].max())])
        ax.plot(
            line / scale,
            slope * line / blocks,
            "--",
            color="0.4",
            label=f"least squares through 0 (n = {last}, r = {float(dataset.length_correlation):.2f})",
        )
    ax.set(xlabel=r"Force / $F_s$", ylabel="Length / slider length", xlim=(0, None), ylim=(0, 1.08))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure
