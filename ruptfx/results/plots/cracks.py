"""Figure of the cracks of a body, their growth, and the resisting force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from ruptfx.results.analysis.compression import slowest
from ruptfx.results.analysis.emission import tried
from ruptfx.results.figure_style import GUIDE, MUTED, WIDTH, note
from ruptfx.results.plots._sheet import Sheet, Window, figure, pair
from ruptfx.results.record import Data, Files

COLOURS = {"tensile": "#c0392b", "shear": "#2a6099", "mixed": "#8e44ad"}
"""Of events, by mode."""
PANELS = ("facets", "force", "growth")
CROWDED = 500  # number of events above which their points are smaller


def suits(record: Files) -> bool:
    """Return whether facets of cracked bodies were saved."""
    return (record.path / "cracks.h5").is_file() and record.cracks.sizes["time"] > 0


@figure
def cracks(sheet: Sheet, record: Files, *, x: Window | None = None, field: str | Sequence[str] | None = None) -> None:
    """Draw failed facets until the last snapshot, the force at the edge with the largest one, and crack growth.

    Failed facets have the colour of their mode, damaged ones are grey. Notches are black. Lines are at undisplaced
    positions. Points are distances of failed facets from the first one, when they failed; a front that starts there
    at the Rayleigh wave speed of the slowest body beside facets is dashed. A panel that would be empty is left out.

    Parameters
    ----------
    x
        Range of x in the map of facets [m]. Default: the bodies.
    field
        Panels: "facets", "force", "growth". Default: all.
    """
    data, events = record.cracks, record.events
    edge = _strongest(record)
    filled = {"facets": True, "force": edge is not None, "growth": len(events["mode"].values) > 1}
    wanted = sheet.choose(field, [name for name in PANELS if filled[name]])
    beside = [name for name in wanted if name != "facets"]
    rows: Any = [["facets", name] for name in beside] if "facets" in wanted else [[name] for name in beside]
    ratios = [1, 1.1] if beside and "facets" in wanted else [1]
    panels = sheet.mosaic(wanted, rows or [["facets"]], WIDTH, 4.2, width_ratios=ratios)
    modes = []
    if "facets" in wanted:
        modes = _facets(sheet, panels["facets"], record, x)
    if edge is not None and "force" in wanted:
        _force(sheet, panels["force"], record, edge)
    speed = _growth(sheet, panels["growth"], record) if "growth" in wanted else None
    names = [mode for mode in COLOURS if mode in modes]
    handles = [Line2D([], [], color=COLOURS[mode], lw=1.3, label=f"{mode} ({modes.count(mode)})") for mode in names]
    if speed is not None:
        handles.append(Line2D([], [], ls="--", color=GUIDE, lw=0.8, label=f"$c_R$ = {speed:.4g} m/s"))
    if handles and sheet.is_given:
        panels[wanted[0]].legend(handles=handles)
    elif handles:  # outside of all panels, so that it covers no letter and no point
        sheet.figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    sheet.letter(panels.values())
    time = float(data["time"].values[-1])
    size, unit = sheet.scale("time", time, "s")
    when = f"{time / size:.4g} {unit}"
    sheet.remark(f"Facets at {when}, where they were at the start. A facet that failed is one event.")


def _facets(sheet: Sheet, ax: Axes, record: Files, x: Window | None) -> list[str]:
    """Draw the facets at the last snapshot; return the modes of those that failed."""
    data, events = record.cracks, record.events
    lines = data["points"].values[data["lines"].values]
    status = data["status"].values[-1]
    size, unit = sheet.scale("x", np.ptp(lines.reshape(-1, 2), axis=0), "m")
    ax.add_collection(LineCollection(list(lines / size), colors="#ececec", linewidths=0.2))
    middle = {tuple(np.round(line.mean(axis=0), 12)): mode for line, mode in zip(
        _at(events), events["mode"].values, strict=True)}  # fmt: skip
    failed, damaged = np.flatnonzero(status == 2), np.flatnonzero(status == 1)
    ax.add_collection(LineCollection(list(lines[damaged] / size), colors="#b0b0b0", linewidths=0.6))
    modes = [middle.get(tuple(np.round(lines[facet].mean(axis=0), 12)), "") for facet in failed]
    colours = [COLOURS.get(mode, "#1a1a1a") for mode in modes]
    ax.add_collection(LineCollection(list(lines[failed] / size), colors=colours, linewidths=1.3))
    ax.autoscale_view()
    ax.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", aspect="equal")
    if x is not None:
        ax.set_xlim(*(None if end is None else end / size for end in pair(sheet.name, "x", x)))
    if not any(mode in COLOURS for mode in modes):
        note(ax, "nothing has failed")
    return modes


def _at(events: Data) -> np.ndarray:
    """Return the midpoints of the failed facets, as lines of zero length, shape (events, 1, 2)."""
    return np.stack([events["x"].values, events["y"].values], axis=1)[:, None]


def _strongest(record: Files) -> str | None:
    """Return the column of `edges.csv` with the largest force; None if no edge has a force."""
    edges = record.edges
    if edges.sizes["time"] < 2:
        return None
    forces = [str(column) for column in edges if ".force_" in str(column)]
    largest = {column: float(np.abs(edges[column].values).max(initial=0.0)) for column in forces}
    return max(forces, key=largest.__getitem__) if any(largest.values()) else None


def _force(sheet: Sheet, ax: Axes, record: Files, name: str) -> None:
    """Draw force against displacement at an edge, along the axis of the force."""
    edges = record.edges
    force, moved = edges[name].values, edges[name.replace(".force_", ".displacement_")].values
    x_size, x_unit = sheet.scale("displacement", np.ptp(moved), "m")
    y_size, y_unit = sheet.scale("force", force, record.sum_unit("N"))
    ax.plot(moved / x_size, force / y_size, color="#1a1a1a")
    ax.axhline(0, color=MUTED, lw=0.5)
    edge, _, component = name.rpartition(".force_")
    ax.set(xlabel=f"Displacement {component} of {edge} ({x_unit})")
    ax.set(ylabel=f"Force {component} per\nthickness ({y_unit})")


def _growth(sheet: Sheet, ax: Axes, record: Files) -> float | None:
    """Draw distance of failed facets from the first one against time since its failure; return the drawn speed."""
    x, y, when, mode = (record.events[name].values for name in ("x", "y", "time_of_failure", "mode"))
    first = int(np.argmin(when))
    away, since = np.hypot(x - x[first], y - y[first]), when - when[first]
    (far, far_unit), (size, unit) = sheet.scale("distance", away, "m"), sheet.scale("time", since, "s")
    # In one collection and smaller the more there are, so that no mode and no time covers the others.
    order = np.random.default_rng(0).permutation(len(when))
    colours = [COLOURS.get(str(mode[number]), "#1a1a1a") for number in order]
    ax.scatter(since[order] / size, away[order] / far, 9.0 if len(when) < CROWDED else 1.5, c=colours, lw=0)
    latest = max(float(since.max()), 1e-300)  # positive if all facets fail at once
    ax.set(xlim=(-0.02 * latest / size, 1.05 * latest / size), ylim=(0, 1.1 * max(float(away.max()), 1e-300) / far))
    ax.set(xlabel=f"Time since the first failure ({unit})", ylabel=f"Distance from it ({far_unit})")
    speed = tried(lambda: slowest(record.cracks, "c_R"))
    if isinstance(speed, float):
        ax.plot([0, 2 * away.max() / speed / size], [0, 2 * away.max() / far], "--", color=GUIDE, lw=0.8)
    return speed if isinstance(speed, float) else None
