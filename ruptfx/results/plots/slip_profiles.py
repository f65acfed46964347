"""Figure of slip and displacement jump along the interface at successive times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from ruptfx.results.figure_style import TIME_MAP
from ruptfx.results.plots._record import (
    along,
    at_positions,
    chosen,
    end_time,
    has_slip_rates,
    nearest,
    quantity,
    signed,
    turned,
)
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Data, Files

JUMPS, FIELDS = ("slip", "displacement_jump"), ("pore_pressure", "temperature")
COLUMNS = 2


def suits(record: Files) -> bool:
    """Return whether the run has an interface with slip or a displacement jump."""
    if not has_slip_rates(record):
        return False
    data = record.interface
    return any(data[name].values.any() for name in JUMPS if name in data)


@figure
def slip_profiles(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str | Sequence[str] | None = None,
) -> None:
    """Draw total slip and displacement jump along the interface at successive times, coloured by time.

    The jump contains the elastic stretch of a compliant interface, the slip does not; without stretch there is one
    panel. Both are positive in the direction of the slip; a remark states if that reverses their sign.

    Parameters
    ----------
    at
        Times [s]; the nearest saved ones are drawn. Default: twelve over the run.
    field
        Fields of the interface, a panel each, such as "opening". Default: "slip", "displacement_jump" where it
        differs from it, and "pore_pressure" and "temperature" of an interface that has them.
    """
    data = at_positions(record.interface, x, sheet.name)
    saved = data["time"].values
    if not len(saved):
        sheet.empty("no time was saved", "Position along the interface (m)", "Time (s)")
        return
    rows = np.unique(chosen(saved, at, nearest(saved, np.linspace(saved[0], saved[-1], 13)[1:])))
    wanted = _default(data, rows) if field is None else [field] if isinstance(field, str) else list(field)
    meant = {name: quantity(data, name, sheet.name) for name in wanted}
    values = {name: signed(record, name) * data[name].isel(time=rows).values for name in wanted}
    position, until = data["position"].values, end_time(record)
    (x_size, x_unit), (t_size, t_unit) = sheet.scale("x", np.ptp(position), "m"), sheet.scale("time", until, "s")
    same = len({each.unit for each in meant.values()}) == 1
    sheet.one_of(f"choose one with field = '{wanted[0]}'")
    lines = -(-len(wanted) // COLUMNS)
    axes = sheet.panels(lines, -(-len(wanted) // lines), 2.6 * lines, sharex=True, sharey=same).ravel()
    for ax in axes[len(wanted) :]:
        ax.set_visible(False)
    colours = ScalarMappable(Normalize(0, until / t_size), TIME_MAP)
    for ax, name in zip(axes, wanted, strict=False):
        shown = np.array([values[other] for other in wanted if meant[other].unit == meant[name].unit])
        size, unit = sheet.scale(name, shown, meant[name].unit)
        for row, line in zip(rows, values[name], strict=True):
            ax.plot(position / x_size, line / size, color=colours.to_rgba(saved[row] / t_size))
        ax.set(xlabel=along(record, x_size, x_unit), ylabel=f"{meant[name].label} ({unit})")
        ax.set_xlim(position[0] / x_size, position[-1] / x_size)
    sheet.figure.colorbar(colours, ax=axes.tolist(), label=f"Time ({t_unit})")
    sheet.letter(axes[: len(wanted)])
    sheet.remark(turned(record) if any(signed(record, name) < 0 for name in wanted) else "")


def _default(data: Data, rows: np.ndarray) -> list[str]:
    """Return the names of the jumps that differ from each other and are not zero, and of pressure and temperature."""
    values = {name: data[name].isel(time=rows).values for name in JUMPS if name in data}
    stretch = np.abs(values["displacement_jump"] - values["slip"]) if "displacement_jump" in values else np.zeros(1)
    if stretch.max(initial=0.0) <= 1e-6 * np.abs(values["slip"]).max(initial=0.0):  # rigid contact
        values.pop("displacement_jump", None)
    if len(values) > 1 and not values["slip"].any():
        values.pop("slip")
    return [*values, *(name for name in FIELDS if name in data)]
