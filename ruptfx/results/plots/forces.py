"""Figure of the forces between two sliding bodies, and of the contact states of their interface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ruptfx.results.analysis.force_drops import averaged, drops, knees
from ruptfx.results.figure_style import Array, scale
from ruptfx.results.plots._record import has_surface
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.plots._states import COLOURS, explain
from ruptfx.results.record import Data, Files

PANELS = ("forces", "states")
DROP, BEND = 0.05, 0.01  # of the normal force: smallest drop, and tolerance of the polyline
MOST = 30  # largest number of drops that are drawn
SEEN = 0.005  # of the largest force: difference of a record from the mean that is wider than a line


def suits(record: Files) -> bool:
    """Return whether an interface has finite sliding."""
    return any(record.path.glob("forces*.csv"))


@figure
def forces(
    sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None, window: float | None = None
) -> None:
    """Draw normal and shear force against time with drops and knees, and the fractions of the contact states.

    A drop is a fall of the shear force by more than 5 % of the median normal force. Knees are the corners of the
    polyline that follows the shear force within 1 % of that.

    Parameters
    ----------
    field
        Panels: "forces", "states". Default: both.
    window : float, optional
        Averaging time of forces before drops are detected [s]. Default: 1/200 of the run.
    """
    table = record.forces
    time = table["time"].values
    if len(time) < 2:
        sheet.empty("fewer than two times were saved", "Time (s)", "Force (N/m)")
        return
    wanted = sheet.choose(field, PANELS)
    ratios = [{"forces": 1.5, "states": 1}[name] for name in wanted]
    axes = sheet.panels(len(wanted), 1, 1.0 + 1.6 * len(wanted), sharex=True, height_ratios=ratios)[:, 0]
    panels = dict(zip(wanted, axes, strict=True))
    t_size, t_unit = sheet.scale("time", time, "s")
    window = (time[-1] - time[0]) / 200 if window is None else window
    remarks = _forces(sheet, panels["forces"], record, window, t_size) if "forces" in panels else ()
    if "states" in panels:
        below = panels["states"]
        below.stackplot(time / t_size, [table[name].values for name in COLOURS], colors=list(COLOURS.values()), lw=0)
        measure = "area" if has_surface(record) else "length"
        below.set(ylabel=f"Fraction of the {measure}", ylim=(0, 1))
        shown = [name for name in COLOURS if table[name].values.any()]
        explain(below, shown, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    axes[-1].set(xlabel=f"Time ({t_unit})", xlim=(time[0] / t_size, time[-1] / t_size))
    sheet.letter(axes)
    sheet.remark(*remarks)


def _shear(table: Data) -> Array:
    """Return the shear force, of a surface its part along the largest one [N or N/m]."""
    if "shear_force" in table:
        return np.asarray(table["shear_force"].values)
    components = np.stack([table[f"shear_force_{k}"].values for k in (1, 2)], axis=1)
    size = np.linalg.norm(components, axis=1)
    return np.asarray(components @ components[np.argmax(size)] / max(float(size.max()), 1e-300))


def _forces(sheet: Sheet, ax: Axes, record: Files, window: float, t_size: float) -> tuple[str, ...]:
    """Draw the forces, drops and knees; return the remarks."""
    table = record.forces
    time, normal, shear = table["time"].values, table["normal_force"].values, _shear(table)
    f_size, f_unit = sheet.scale("force", np.array([normal, shear]), record.sum_unit("N"))
    mean = averaged(time, shear, window)
    sign = -1.0 if mean[np.argmax(np.abs(mean))] < 0 else 1.0
    typical = float(np.median(normal))
    ax.plot(time / t_size, normal / f_size, color="#3a7d44", lw=0.6, label="normal force")
    differs = float(np.abs(mean - shear).max()) > SEEN * float(max(np.abs(normal).max(), np.abs(shear).max()))
    if differs:
        ax.plot(time / t_size, shear / f_size, color="#bbbbbb", lw=0.6)
    ax.plot(time / t_size, mean / f_size, color="#1a1a1a", label="shear force")
    result = drops(time, sign * mean, DROP * typical) if typical > 0 else []
    bends = knees(time, sign * mean, result, BEND * typical) if typical > 0 else []
    bends = [bend for bend in bends if sign * np.interp(bend.time, time, mean) > DROP * typical]
    too_many = len(result) > MOST
    for number, drop in enumerate([] if too_many else result):
        ax.axvspan(drop.start / t_size, drop.end / t_size, color="#e07b39", alpha=0.3, lw=0,
                   label="drops" if number == 0 else None)  # fmt: skip
    at = np.array([] if too_many else [bend.time for bend in bends])
    if len(at):
        ax.plot(at / t_size, np.interp(at, time, mean) / f_size, "o", mfc="white", color="#b5382a", label="knees")
    ax.set_ylabel(f"Force{'' if has_surface(record) else ' per thickness'} ({f_unit})")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    size, unit = scale(window, "s")
    limit = f"{100 * DROP:.0f} % of the median normal force"
    return (
        f"Grey: shear force of every record; black: its mean over {window / size:.3g} {unit}." if differs else "",
        f"{len(result)} drops by more than {limit} are too many to be marked." if too_many
        else f"Drops are larger than {limit}." if result else "",
    )  # fmt: skip
