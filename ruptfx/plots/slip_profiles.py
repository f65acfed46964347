"""Figure of slip and displacement jump along the interface at successive times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ruptfx.figure_style import TIME_MAP, empty_figure, letter, new_figure, remark, scale, styled
from ruptfx.plots._record import along, direction, end_time, has_slip_rates, nearest, turned
from ruptfx.record import Files

JUMPS = {"slip": "Slip", "displacement_jump": "Displacement jump"}


def suits(record: Files) -> bool:
    """Return whether the run has an interface with slip or a displacement jump."""
    if not has_slip_rates(record):
        return False
    data = record.interface
    return any(data[name].values.any() for name in JUMPS if name in data)


@styled
def slip_profiles(record: Files, times: Sequence[float] | None = None) -> Figure:
    """Draw total slip and displacement jump along the interface at successive times, coloured by time.

    The jump contains the elastic stretch of a compliant interface, the slip does not; without stretch there is one
    panel. Both are positive in the direction of the slip; a remark states if that reverses their sign.

    Parameters
    ----------
    record : Record or Files
    times : sequence of float, optional
        Times [s]; the nearest saved ones are drawn. Default: twelve over the run.
    """
    data = record.interface
    saved = data["time"].values
    if not len(saved):
        return empty_figure("no time was saved", "Position along the interface (m)", "Time (s)")
    wanted = np.linspace(saved[0], saved[-1], 13)[1:] if times is None else np.asarray(times)
    rows = np.unique(nearest(saved, wanted))
    position, sign = data["position"].values, direction(record)
    until = end_time(record)
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(until, "s")
    values = {name: sign * data[name].isel(time=rows).values for name in JUMPS if name in data}
    stretch = np.abs(values["displacement_jump"] - values["slip"]) if "displacement_jump" in values else np.zeros(1)
    if stretch.max(initial=0.0) <= 1e-6 * np.abs(values["slip"]).max(initial=0.0):  # rigid contact
        values.pop("displacement_jump", None)
    if len(values) > 1 and not values["slip"].any():
        values.pop("slip")
    size, unit = scale(np.array(list(values.values())), "m")
    figure, axes = new_figure(1, len(values), 2.6, sharex=True, sharey=True)
    colours = ScalarMappable(Normalize(0, until / t_size), TIME_MAP)
    for ax, (name, lines) in zip(axes[0], values.items(), strict=True):
        for row, line in zip(rows, lines, strict=True):
            ax.plot(position / x_size, line / size, color=colours.to_rgba(saved[row] / t_size))
        ax.set(xlabel=along(record, x_size, x_unit), ylabel=f"{JUMPS[name]} ({unit})")
        ax.set_xlim(position[0] / x_size, position[-1] / x_size)
    figure.colorbar(colours, ax=axes[0].tolist(), label=f"Time ({t_unit})")
    remark(figure, turned(record))
    letter(axes[0])
    return figure
