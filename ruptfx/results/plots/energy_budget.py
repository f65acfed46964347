"""Figure of the energy budget."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ruptfx.results.analysis.energy import closure, parts_of
from ruptfx.results.figure_style import MUTED, Array, note
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.record import Files

PANELS = ("energies", "closure")
_COLOURS = {
    "kinetic": "#0072b2",
    "strain": "#009e73",
    "interface_elastic": "#cc79a7",
    "frictional_dissipation": "#d55e00",
    "fracture": "#8b5a2b",
    "damping": "#e69f00",
    "impact_loss": "#56b4e9",
    "collisions": "#332288",
    "collision_loss": "#999933",
    "pairing_update_loss": "#7f7f7f",
    "rotation_error": "#117733",
}  # safe for colour-blind readers
_ROUNDING = 100 * np.finfo(float).eps  # per cent: rounding level, lower limit of the axis
SEEN = 1e-3  # of the largest energy: smaller ones are not drawn
_TOLERANCE = 1e-3  # of the boundary work: limit for a sound run


def suits(record: Files) -> bool:
    """Return whether energies were saved."""
    return (record.path / "energy.csv").is_file()


@figure
def energy_budget(sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None) -> None:
    """Draw energies against time, and the unaccounted part of the boundary work.

    Energies below a thousandth of the largest are named but not drawn.

    Parameters
    ----------
    field
        Panels: "energies", "closure". Default: both.
    """
    energy = record.energy
    time = energy["time"].values
    wanted = sheet.choose(field, PANELS)
    ratios = [{"energies": 2, "closure": 1}[name] for name in wanted]
    panels = dict(zip(wanted, sheet.panels(1, len(wanted), 2.8, width_ratios=ratios)[0], strict=True))
    t_size, t_unit = sheet.scale("time", time, "s")
    parts = {name: energy[name].values for name in parts_of(energy)}
    small = _energies(sheet, panels["energies"], record, parts, time / t_size) if "energies" in panels else []
    if "closure" in panels:
        _closure(panels["closure"], energy["boundary_work"].values, parts, time / t_size)
    for ax in panels.values():
        ax.set_xlabel(f"Time ({t_unit})")
        if len(time) < 2:
            note(ax, "fewer than two times were saved")
        else:
            ax.set_xlim(time[0] / t_size, time[-1] / t_size)
    sheet.letter(panels.values())
    sheet.remark(f"Below {SEEN:.1%} of the largest, and not drawn: {', '.join(small)}." if small else "")


def _energies(sheet: Sheet, ax: Axes, record: Files, parts: dict[str, Array], time: Array) -> list[str]:
    """Draw the energies; return the names of those that are too small to be seen."""
    work = record.energy["boundary_work"].values
    largest = {name: float(np.abs(values).max(initial=0.0)) for name, values in (*parts.items(), ("", work))}
    small = [name for name in parts if largest[name] < SEEN * max(largest.values())]
    seen = {name: values for name, values in parts.items() if name not in small}
    size, unit = sheet.scale("energy", np.array([work, *seen.values()]), record.sum_unit("J"))
    ax.set_ylabel(f"Energy per thickness ({unit})" if unit.endswith("/m") else f"Energy ({unit})")
    if largest[""] > 0:
        ax.plot(time, work / size, color="#1a1a1a", lw=1.4, label="work")
    for name, values in seen.items():
        ax.plot(time, values / size, color=_COLOURS.get(name, MUTED), label=name.replace("_", " "))
    if ax.lines:
        ax.legend(loc="best")
    else:
        note(ax, "no energy")
    return [name.replace("_", " ") for name in small if largest[name] > 0]


def _closure(ax: Axes, work: Array, parts: dict[str, Array], time: Array) -> None:
    """Draw the unaccounted part of the work, and the tolerance."""
    missing = 100 * np.abs(closure(work, parts))
    ax.semilogy(time, np.maximum(missing, _ROUNDING), color="#1a1a1a")
    ax.axhline(100 * _TOLERANCE, color=MUTED, lw=0.8, ls="--")
    ax.set_ylabel("Unaccounted (% of work)")
    ax.set_ylim(top=100 * max(10 * _TOLERANCE, 2 * missing.max(initial=0) / 100))
    ax.annotate(
        "tolerance",
        (0.02, 100 * _TOLERANCE),
        (0, -2),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        color=MUTED,
        va="top",
    )
