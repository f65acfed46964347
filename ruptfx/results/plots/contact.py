"""Figure of the state of contact in space and time."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import ListedColormap

from ruptfx.results.figure_style import edges
from ruptfx.results.plots._record import along, at_positions, end_time
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.plots._states import COLOURS, explain, has_states, names_of
from ruptfx.results.record import Files


def suits(record: Files) -> bool:
    """Return whether an interface has finite sliding."""
    return has_states(record)


@figure
def contact(sheet: Sheet, record: Files, *, x: Window | None = None) -> None:
    """Draw which points stick, slide, are open or uncovered, against position and time."""
    data = at_positions(record.interface, x, sheet.name)
    position, time = data["position"].values, data["time"].values
    until = end_time(record)
    (x_size, x_unit), (t_size, t_unit) = sheet.scale("x", np.ptp(position), "m"), sheet.scale("time", until, "s")
    labels = along(record, x_size, x_unit), f"Time ({t_unit})"
    if len(time) < 2:
        sheet.empty("fewer than two times were saved", *labels)
        return
    ax = sheet.panels(1, 1, 3.6, 4.8)[0, 0]
    ax.set(xlabel=labels[0], ylabel=labels[1], ylim=(record.since / t_size, until / t_size))
    colours = ListedColormap(list(COLOURS.values()))
    grid = edges(position) / x_size, edges(time) / t_size
    states = data["contact"].values
    ax.pcolormesh(*grid, states, cmap=colours, vmin=-0.5, vmax=len(COLOURS) - 0.5, rasterized=True)
    explain(ax, names_of(states), loc="lower center", bbox_to_anchor=(0.5, 1.0), columnspacing=1.0, handlelength=1.2)
    sheet.remark(f"States of {len(time)} records; what is shorter than the time between them is not seen.")
