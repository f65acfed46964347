"""Figure of the acoustic emission of a fracturing body: load, positions, magnitudes, times and directions."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ruptfx.analysis.compression import MODES, Emission, emission_of, events_that_count, loading
from ruptfx.analysis.emission import FractalDimension, rose
from ruptfx.figure_style import MUTED, WIDTH, blank_figure, letter, note, remark, scale, styled
from ruptfx.plots._catalogue import pairs, rates, sizes
from ruptfx.plots.cracks import COLOURS
from ruptfx.record import Files

LEAST = 50  # events: the minimum for statistics
LARGEST_MARK = 40.0  # points^2


def suits(record: Files) -> bool:
    """Return whether enough facets of the run failed and radiated for statistics."""
    return (record.path / "events.h5").is_file() and events_that_count(record) > LEAST


@styled
def emission(record: Files, found: Emission | None = None) -> Figure:
    """Draw stress and events, their positions, magnitudes, distances, rates and directions; no empty panel.

    Parameters
    ----------
    record : Record or Files
    found : Emission, optional
        Statistics with other limits than the default.
    """
    found = emission_of(record) if found is None else found
    figure = blank_figure(WIDTH, 8.6)
    # Left, one above the other: load, sizes, distances, times; right: the map and the rose.
    axes = figure.subplot_mosaic("lm;lm;sm;sm;dm;dr;tr;tr", per_subplot_kw={"r": {"projection": "polar"}})
    _load(axes["l"], record, found)
    _map(axes["m"], record, found)
    _magnitudes(axes["s"], found)
    pairs(axes["d"], found.of_events.D)
    rates(axes["t"], found.seismic, found.of_events.p, found.failure_time)
    _rose(axes["r"], found)
    shown = {"s": len(found.linked) > 0, "d": isinstance(found.of_events.D, FractalDimension),
             "t": len(found.seismic) > 0, "r": bool(found.before.any())}  # fmt: skip
    for name, full in shown.items():
        axes[name].set_visible(full)
    letter(axes[name] for name in "lmsdrt" if axes[name].get_visible())
    remark(figure, *_remarks(found))
    return figure


def _remarks(found: Emission) -> list[str]:
    when = "of the whole run"
    if found.failure_time is not None:
        size, unit = scale(found.failure_time, "s")
        when = f"before {found.failure_time / size:.4g} {unit}"
    shares = ", ".join(f"{name} {share:.0%}" for name, share in found.shares.items() if len(found.seismic))
    of_these = f"{len(found.seismic)} of these radiate a magnitude of -10 at least"
    known = {part: share for part, share in found.tensile_shares.items() if np.isfinite(share)}
    windows = ", ".join(f"{share:.0%} until {part:.0%}" for part, share in known.items())
    return [
        f"{len(found.events)} facets failed, {found.before.sum()} {when}; {of_these}{f': {shares}' if shares else ''}.",
        f"Tensile share by window: {windows} of that time." if windows else "",
        "Circles in b: events of these, grey: facets that failed until the end. Black in c: clusters of the whole run.",
    ]  # fmt: skip


def _magnitudes(ax: Axes, found: Emission) -> None:
    """Draw the magnitudes of clusters, with their b-value, and of single facets."""
    if len(found.linked):
        sizes(ax, found.linked, found.of_clusters)
    else:
        note(ax, "no seismic event")
    M = np.sort(found.seismic.magnitude)
    ax.plot(M, np.arange(len(M), 0, -1), ".", color=COLOURS["shear"], ms=2, label="single facets")
    ax.set_ylim(top=50 * max(len(M), 1))  # room for the inset
    ax.legend(loc="lower left", fontsize=6)


def _load(ax: Axes, record: Files, found: Emission) -> None:
    """Draw stress against strain, or time, and the number of events."""
    pressed = loading(record)
    count = np.arange(1, len(found.events) + 1)
    failed = np.asarray(record.events["time_of_failure"].values)
    if pressed is None:
        size, unit = scale(failed, "s")
        ax.plot(failed / size, count, color=COLOURS["tensile"], lw=1)
        ax.set(xlabel=f"Time ({unit})", ylabel="Number of failures")
        return
    size, unit = scale(pressed.stress, "Pa")
    pulled = pressed.stress.max() < -pressed.stress.min()
    sign = -1.0 if pulled else 1.0
    strain, stress = 100 * sign * pressed.strain, sign * pressed.stress / size
    ax.plot(strain, stress, color="#1a1a1a", lw=1)
    if pressed.peak is not None:
        ax.plot(strain[pressed.peak], stress[pressed.peak], "o", color=COLOURS["tensile"], ms=4)
    way = "Tensile" if pulled else "Compressive"
    ax.set(xlabel=f"{way} strain (%)", ylabel=f"{way} stress ({unit})")
    ax.locator_params(axis="x", nbins=6)
    right = ax.twinx()
    right.plot(np.interp(failed, pressed.time, strain), count, color=COLOURS["shear"], lw=1)
    right.set_ylabel("Number of failures", color=COLOURS["shear"])
    right.tick_params(axis="y", colors=COLOURS["shear"])


def _map(ax: Axes, record: Files, found: Emission) -> None:
    """Draw events before the failure by mode; all facets that failed until the end are grey."""
    data = record.cracks
    lines = data["points"].values[data["lines"].values]
    (size, unit) = scale(np.ptp(lines.reshape(-1, 2), axis=0), "m")
    if data.sizes["time"]:
        failed = data["status"].values[-1] == 2
        ax.add_collection(LineCollection(list(lines[failed] / size), colors="#c8c8c8", linewidths=0.5))
    low, high = (value / size for value in (lines.min(axis=(0, 1)), lines.max(axis=(0, 1))))
    M, modes = found.seismic.magnitude, found.mode[found.counted]
    span = max(float(np.ptp(M)), 1.0) if len(M) else 1.0
    for name in MODES:
        here = modes == name
        if not here.any():
            continue
        area = 1 + (LARGEST_MARK - 1) * np.clip(1 + (M[here] - M.max(initial=-np.inf)) / span, 0, 1) ** 2
        ax.scatter(found.seismic.x[here] / size, found.seismic.y[here] / size, area, facecolors="none",
                   edgecolors=COLOURS[name], linewidths=0.6, label=f"{name} ({here.sum()})")  # fmt: skip
    ax.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    if len(M):
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.04), ncols=3, fontsize=6, handletextpad=0.0,
                  columnspacing=0.5, borderpad=0.0)  # fmt: skip


def _rose(ax: Axes, found: Emission) -> None:
    """Draw the length of failed facets by their direction, before the failure."""
    limits, length = rose(found.inclination[found.before], found.length[found.before])
    (size, unit) = scale(length, "m") if length.any() else (1.0, "m")
    for turn in (0.0, 180.0):
        ax.bar(np.radians(limits[:-1] + turn), length / size, np.radians(np.diff(limits)), align="edge",
               color=COLOURS["shear"], edgecolor="white", linewidth=0.4)  # fmt: skip
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel(f"Length of failed facets by direction ({unit})", fontsize=7)
    ax.tick_params(labelsize=6, colors=MUTED)
