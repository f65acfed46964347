"""Figure of the forces between two sliding bodies, and of the contact states of their interface."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.force_drops import averaged, drops, knees
from ruptfx.figure_style import empty_figure, letter, new_figure, note, remark, scale, styled
from ruptfx.plots._states import COLOURS, explain
from ruptfx.record import Files

DROP, BEND = 0.05, 0.01  # of the normal force: smallest drop, and tolerance of the polyline
MOST = 30  # largest number of drops that are drawn


def suits(record: Files) -> bool:
    """Return whether an interface has finite sliding."""
    return any(record.path.glob("forces*.csv"))


@styled
def forces(record: Files, window: float | None = None) -> Figure:
    """Draw normal and shear force against time with drops and knees, and the fractions of the contact states.

    Parameters
    ----------
    record : Record or Files
    window : float, optional
        Averaging time of forces before drops are detected [s]. Default: 1/200 of the run.
    """
    table = record.forces
    time = table["time"].values
    if len(time) < 2:
        return empty_figure("fewer than two times were saved", "Time (s)", "Force (N/m)")
    window = (time[-1] - time[0]) / 200 if window is None else window
    normal, shear = (table[name].values for name in ("normal_force", "shear_force"))
    (t_size, t_unit), (f_size, f_unit) = scale(time, "s"), scale(np.array([normal, shear]), "N/m")
    figure, axes = new_figure(2, 1, 4.2, sharex=True, height_ratios=[1.5, 1])
    above, below = axes[:, 0]
    mean = averaged(time, shear, window)
    turned = -1.0 if mean[np.argmax(np.abs(mean))] < 0 else 1.0
    typical = float(np.median(normal))
    above.plot(time / t_size, normal / f_size, color="#3a7d44", lw=0.6, label="normal force")
    above.plot(time / t_size, shear / f_size, color="#bbbbbb", lw=0.6)
    above.plot(time / t_size, mean / f_size, color="#1a1a1a", label="shear force")
    found = drops(time, turned * mean, DROP * typical) if typical > 0 else []
    bends = knees(time, turned * mean, found, BEND * typical) if typical > 0 else []
    bends = [bend for bend in bends if turned * np.interp(bend.time, time, mean) > DROP * typical]
    for number, drop in enumerate(found if len(found) <= MOST else []):
        above.axvspan(drop.start / t_size, drop.end / t_size, color="#e07b39", alpha=0.3, lw=0,
                      label="drops" if number == 0 else None)  # fmt: skip
    too_many = len(found) > MOST
    if too_many:
        bends = []
    at = np.array([bend.time for bend in bends])
    if len(at):
        above.plot(at / t_size, np.interp(at, time, mean) / f_size, "o", mfc="white", color="#b5382a", label="knees")
    else:
        note(above, "" if len(found) else "no drops, no knees")
    above.set_ylabel(f"Force per thickness ({f_unit})")
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
    below.stackplot(time / t_size, [table[name].values for name in COLOURS], colors=list(COLOURS.values()), lw=0)
    below.set(xlabel=f"Time ({t_unit})", ylabel="Fraction of the length", ylim=(0, 1))
    below.set_xlim(time[0] / t_size, time[-1] / t_size)
    explain(below, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    letter(axes.ravel())
    size, unit = scale(window, "s")
    falls = f"falls by more than {100 * DROP:.0f} % of the median normal force"
    told = f"Drops: {falls}, until it rises by a fifth of that; knees: bends of a broken line that follows within " \
           f"{100 * BEND:.0f} % of it."
    if too_many:
        told = f"{len(found)} {falls} are too many to be marked: the bodies bounce, or what slides chatters."
    elif not found and not bends:
        told = ""
    remark(
        figure, f"Grey: shear force of every record; black: its mean over {window / size:.3g} {unit}.",
        told,
    )  # fmt: skip
    return figure
