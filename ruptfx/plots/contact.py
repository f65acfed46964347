"""Figure of the state of contact in space and time."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ruptfx.figure_style import edges, empty_figure, new_figure, remark, scale, styled
from ruptfx.plots._record import along, end_time
from ruptfx.plots._states import COLOURS, explain, has_states
from ruptfx.record import Files


def suits(record: Files) -> bool:
    """Return whether an interface has finite sliding."""
    return has_states(record)


@styled
def contact(record: Files, time_range: tuple[float, float] | None = None) -> Figure:
    """Draw which points stick, slide, are open or uncovered, against position and time.

    Parameters
    ----------
    record : Record or Files
    time_range : (float, float), optional
        Time range of the figure [s]. Default: all.
    """
    data = record.interface
    position, time = data["position"].values, data["time"].values
    first, until = time_range or (0.0, end_time(record))
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(until, "s")
    labels = along(record, x_size, x_unit), f"Time ({t_unit})"
    if len(time) < 2:
        return empty_figure("fewer than two times were saved", *labels)
    figure, axes = new_figure(1, 1, 3.6, 4.8)
    ax = axes[0, 0]
    ax.set(xlabel=labels[0], ylabel=labels[1], ylim=(first / t_size, until / t_size))
    colours = ListedColormap(list(COLOURS.values()))
    grid = edges(position) / x_size, edges(time) / t_size
    ax.pcolormesh(*grid, data["contact"].values, cmap=colours, vmin=-0.5, vmax=len(COLOURS) - 0.5, rasterized=True)
    explain(ax, loc="lower center", bbox_to_anchor=(0.5, 1.0), columnspacing=1.0, handlelength=1.2)
    remark(figure, f"States of {len(time)} records; what is shorter than the time between them is not seen.")
    return figure
