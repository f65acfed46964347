"""Figure of the energy budget."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.energy import closure, parts_of
from ruptfx.figure_style import MUTED, letter, new_figure, note, remark, scale, styled
from ruptfx.record import Files

_COLOURS = {
    "kinetic": "#0072b2", "strain": "#009e73", "interface_elastic": "#cc79a7", "frictional_dissipation": "#d55e00",
    "fracture": "#8b5a2b", "damping": "#e69f00", "impact_loss": "#56b4e9", "collisions": "#332288",
    "collision_loss": "#999933",
    "pairing_update_loss": "#7f7f7f", "rotation_error": "#117733",
}  # safe for colour-blind readers
_ROUNDING = 100 * np.finfo(float).eps  # per cent: rounding level, lower limit of the axis
SEEN = 1e-3  # of the largest energy: smaller ones are not drawn
_TOLERANCE = 1e-3  # of the boundary work: limit for a sound run


def suits(record: Files) -> bool:
    """Return whether energies were saved."""
    return (record.path / "energy.csv").is_file()


@styled
def energy_budget(record: Files) -> Figure:
    """Draw energies against time, and the unaccounted part of the boundary work.

    Energies below a thousandth of the largest are named but not drawn.
    """
    energy = record.energy
    time = energy["time"].values
    parts = whole_parts = {name: energy[name].values for name in parts_of(energy)}
    work = energy["boundary_work"].values
    largest = {name: float(np.abs(values).max(initial=0.0)) for name, values in (*parts.items(), ("", work))}
    small = [name for name in parts if largest[name] < SEEN * max(largest.values())]
    named = [name.replace("_", " ") for name in small if largest[name] > 0]
    parts = {name: values for name, values in parts.items() if name not in small}
    (t_size, t_unit), (size, unit) = scale(time, "s"), scale(np.array([work, *parts.values()]), "J/m")
    whole = record.case.get("plane") in ("solid", "axisymmetric")
    label = f"Energy ({unit.removesuffix('/m')})" if whole else f"Energy per thickness ({unit})"
    figure, (axes,) = new_figure(1, 2, 2.8, width_ratios=[2, 1])
    axes[0].plot(time / t_size, work / size, color="#1a1a1a", lw=1.4, label="boundary work")
    for name, values in parts.items():
        axes[0].plot(time / t_size, values / size, color=_COLOURS.get(name, MUTED), label=name.replace("_", " "))
    axes[0].set(xlabel=f"Time ({t_unit})", ylabel=label)
    axes[0].legend(loc="best")
    missing = 100 * np.abs(closure(work, whole_parts))
    axes[1].semilogy(time / t_size, np.maximum(missing, _ROUNDING), color="#1a1a1a")
    axes[1].axhline(100 * _TOLERANCE, color=MUTED, lw=0.8, ls="--")
    axes[1].set(xlabel=f"Time ({t_unit})", ylabel="Unaccounted (% of boundary work)")
    axes[1].set_ylim(top=100 * max(10 * _TOLERANCE, 2 * missing.max(initial=0) / 100))
    axes[1].annotate("tolerance", (0.02, 100 * _TOLERANCE), (0, -2), xycoords=("axes fraction", "data"),
                     textcoords="offset points", color=MUTED, va="top")
    for ax in axes:
        if len(time) < 2:
            note(ax, "fewer than two times were saved")
        else:
            ax.set_xlim(time[0] / t_size, time[-1] / t_size)
    remark(figure, f"Below {SEEN:.1%} of the largest, and not drawn: {', '.join(named)}." if named else "")
    letter(axes)
    return figure
