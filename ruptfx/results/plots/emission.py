"""Figure of the acoustic emission of a fracturing body: load, positions, magnitudes, times and directions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from ruptfx.results.analysis.compression import MODES, Emission, emission_of, events_that_count, loading
from ruptfx.results.analysis.emission import FractalDimension, rose
from ruptfx.results.catalogue_statistics import pairs, rates, sizes
from ruptfx.results.figure_style import MUTED, WIDTH, note, scale
from ruptfx.results.plots._sheet import Sheet, figure_of_whole_run
from ruptfx.results.plots.cracks import COLOURS
from ruptfx.results.record import Files

PANELS = ("load", "map", "magnitudes", "distances", "rose", "rates")
DEFAULT = ("load", "map", "magnitudes", "rates")
LEAST = 50  # events: the minimum for statistics
LARGEST_MARK = 40.0  # points^2


def suits(record: Files) -> bool:
    """Return whether enough facets of the run failed and radiated for statistics."""
    return not record.is_part and (record.path / "events.h5").is_file() and events_that_count(record) > LEAST


@figure_of_whole_run
def emission(
    sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None, found: Emission | None = None
) -> None:
    """Draw stress and events, their positions, magnitudes and rates, or distances and directions; no empty panel.

    Statistics are those of the whole run. The rose needs polar axes.

    Parameters
    ----------
    field
        Panels: "load", "map", "magnitudes", "distances", "rose", "rates". Default: those of these that have data, but
        for "distances" and "rose".
    found : Emission, optional
        Statistics with other limits than the default.
    """
    found = emission_of(record) if found is None else found
    empty = {"magnitudes": not len(found.linked), "distances": not isinstance(found.of_events.D, FractalDimension),
             "rates": not len(found.seismic), "rose": not found.before.any()}  # fmt: skip
    filled = [name for name in PANELS if not empty.get(name)]
    wanted = sheet.choose(field, filled)
    if field is None:
        wanted = [name for name in wanted if name in DEFAULT]
    polar = {"rose": {"projection": "polar"}}
    across = min(2, len(wanted))
    rows = [[*wanted[i : i + across], *"." * (across - len(wanted[i:]))] for i in range(0, len(wanted), across)]
    shapes = {name: options for name, options in polar.items() if name in wanted}
    axes = sheet.mosaic(wanted, rows, WIDTH * across / 2, 0.4 + 2.4 * len(rows), per_subplot_kw=shapes)
    draws: dict[str, Callable[[Axes], None]] = {
        "load": lambda ax: _load(sheet, ax, record, found), "map": lambda ax: _map(sheet, ax, record, found),
        "magnitudes": lambda ax: _magnitudes(ax, found), "distances": lambda ax: pairs(ax, found.of_events.D),
        "rates": lambda ax: rates(ax, found.seismic, found.of_events.p, found.failure_time),
        "rose": lambda ax: _rose(ax, found),
    }  # fmt: skip
    for name in wanted:
        draws[name](axes[name])
    sheet.letter([axes[name] for name in wanted])
    sheet.remark(*_remarks(found, wanted))


def _remarks(value: Emission, wanted: Sequence[str]) -> list[str]:
    when = "of the whole run"
    if value.failure_time is not None:
        size, unit = scale(value.failure_time, "s")
        when = f"before {value.failure_time / size:.4g} {unit}"
    shares = ", ".join(f"{name} {share:.0%}" for name, share in value.shares.items() if len(value.seismic))
    of_these = f"{len(value.seismic)} of these radiate{f': {shares}' if shares else ''}"
    known = {part: share for part, share in value.tensile_shares.items() if np.isfinite(share)}
    windows = ", ".join(f"{share:.0%} until {part:.0%}" for part, share in known.items())
    failed = f"{len(value.events)} facets failed"
    return [
        f"{failed}; {of_these}." if value.before.all() else f"{failed}, {value.before.sum()} {when}; {of_these}.",
        f"Tensile share by window: {windows} of that time." if windows else "",
        "Circles: events that radiate, grey: all facets that failed." if "map" in wanted else "",
        "Black: clusters of the whole run." if "magnitudes" in wanted else "",
    ]


def _magnitudes(ax: Axes, emission: Emission) -> None:
    """Draw the magnitudes of clusters, with their b-value, and of single facets."""
    if len(emission.linked):
        sizes(ax, emission.linked, emission.of_clusters)
    else:
        note(ax, "no seismic event")
    M = np.sort(emission.seismic.magnitude)
    ax.plot(M, np.arange(len(M), 0, -1), ".", color=COLOURS["shear"], ms=2, label="single facets")
    ax.set_ylim(top=2 * max(len(M), 1))
    ax.legend(loc="lower left", fontsize=6)


def _load(sheet: Sheet, ax: Axes, record: Files, emission: Emission) -> None:
    """Draw stress against strain, or time, and the number of events."""
    pressed = loading(record)
    count = np.arange(1, len(emission.events) + 1)
    failed = np.asarray(record.events["time_of_failure"].values)
    if pressed is None:
        size, unit = sheet.scale("time", failed, "s")
        ax.plot(failed / size, count, color=COLOURS["tensile"], lw=1)
        ax.set(xlabel=f"Time ({unit})", ylabel="Number of failures")
        return
    size, unit = sheet.scale("stress", pressed.stress, "Pa")
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


def _map(sheet: Sheet, ax: Axes, record: Files, emission: Emission) -> None:
    """Draw events before the failure by mode; all facets that failed until the end are grey."""
    data = record.cracks
    lines = data["points"].values[data["lines"].values]
    size, unit = sheet.scale("x", np.ptp(lines.reshape(-1, 2), axis=0), "m")
    if data.sizes["time"]:
        failed = data["status"].values[-1] == 2
        ax.add_collection(LineCollection(list(lines[failed] / size), colors="#c8c8c8", linewidths=0.5))
    low, high = (value / size for value in (lines.min(axis=(0, 1)), lines.max(axis=(0, 1))))
    M, modes = emission.seismic.magnitude, emission.mode[emission.counted]
    span = max(float(np.ptp(M)), 1.0) if len(M) else 1.0
    for name in MODES:
        of_mode = modes == name
        if not of_mode.any():
            continue
        area = 1 + (LARGEST_MARK - 1) * np.clip(1 + (M[of_mode] - M.max(initial=-np.inf)) / span, 0, 1) ** 2
        ax.scatter(emission.seismic.x[of_mode] / size, emission.seismic.y[of_mode] / size, area, facecolors="none",
                   edgecolors=COLOURS[name], linewidths=0.6, label=f"{name} ({of_mode.sum()})")  # fmt: skip
    ax.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    if len(M):
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=6, handletextpad=0.2, borderaxespad=0.0)


def _rose(ax: Axes, emission: Emission) -> None:
    """Draw the length of failed facets by their direction, before the failure."""
    limits, length = rose(emission.inclination[emission.before], emission.length[emission.before])
    (size, unit) = scale(length, "m") if length.any() else (1.0, "m")
    for turn in (0.0, 180.0):
        ax.bar(np.radians(limits[:-1] + turn), length / size, np.radians(np.diff(limits)), align="edge",
               color=COLOURS["shear"], edgecolor="white", linewidth=0.4)  # fmt: skip
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel(f"Length of failed facets by direction ({unit})", fontsize=7)
    ax.tick_params(labelsize=6, colors=MUTED)
