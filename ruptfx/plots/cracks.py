"""Figure of the cracks of a body that breaks, and of the force that it resisted."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ruptfx.figure_style import MUTED, letter, new_figure, note, remark, scale, styled
from ruptfx.record import Data, Files

COLOURS = {"tensile": "#c0392b", "shear": "#2a6099", "mixed": "#8e44ad"}
"""Of events, by mode."""


def suits(record: Files) -> bool:
    """Whether bodies of the run may break, and facets were saved."""
    return (record.path / "cracks.h5").is_file() and record.cracks.sizes["time"] > 0


@styled
def cracks(record: Files) -> Figure:
    """Facets that failed until the last snapshot, and the force at the edge with the largest one.

    Failed facets have the colour of their mode, damaged ones are grey. Notches are black. Lines are where nothing has
    moved yet.
    """
    data, events = record.cracks, record.events
    lines = data["points"].values[data["lines"].values]
    status = data["status"].values[-1]
    (size, unit) = scale(np.ptp(lines.reshape(-1, 2), axis=0), "m")
    figure, ((ax, right),) = new_figure(1, 2, 3.4, width_ratios=[1, 1.1])
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
    names = [mode for mode in COLOURS if mode in modes]
    handles = [Line2D([], [], color=COLOURS[mode], lw=1.3, label=f"{mode} ({modes.count(mode)})") for mode in names]
    if handles:
        ax.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(handles))
    else:
        note(ax, "nothing has failed")
    _force(right, record)
    letter(np.array([ax, right]))
    time = float(data["time"].values[-1])
    size, unit = scale(time, "s")
    when = f"{time / size:.4g} {unit}"
    remark(figure, f"Facets at {when}, where they were at the start. A facet that failed is one event.")
    return figure


def _at(events: Data) -> np.ndarray:
    """Middles of the facets that failed, as lines of no length, shape (events, 1, 2)."""
    return np.stack([events["x"].values, events["y"].values], axis=1)[:, None]


def _force(ax: Axes, record: Files) -> None:
    """Force against displacement at the edge with the largest force, along the axis of that."""
    edges = record.edges
    forces = [str(column) for column in edges if ".force_" in str(column)]
    if not forces or edges.sizes["time"] < 2:
        note(ax, "no edge was moved or loaded")
        ax.set(xlabel="Displacement (m)", ylabel="Force per thickness (N/m)")
        return
    name = max(forces, key=lambda column: float(np.abs(edges[column].values).max()))
    force, moved = edges[name].values, edges[name.replace(".force_", ".displacement_")].values
    (x_size, x_unit), (y_size, y_unit) = scale(np.ptp(moved), "m"), scale(force, "N/m")
    ax.plot(moved / x_size, force / y_size, color="#1a1a1a")
    ax.axhline(0, color=MUTED, lw=0.5)
    edge, _, component = name.rpartition(".force_")
    ax.set(xlabel=f"Displacement {component} of {edge} ({x_unit})")
    ax.set(ylabel=f"Force {component} per thickness ({y_unit})")
