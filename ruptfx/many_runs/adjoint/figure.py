"""Figure of a gradient: sensitivity to every unknown along the interface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.results.figure_style import new_figure, scale, styled

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


@styled
def draw(result: xarray.Dataset) -> Figure:
    """Return the figure: derivative per length of the interface by each unknown field, or by knots, over the position.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `ruptfx.gradient`.
    """
    fields = [name for name, values in result.data_vars.items() if "unknown" in values.attrs and values.dims]
    numbers = [name for name, values in result.data_vars.items() if "unknown" in values.attrs and not values.dims]
    figure, axes = new_figure(max(len(fields), 1), 1, 1.5 * max(len(fields), 1) + 0.6, sharex=True)
    for ax, name in zip(axes[:, 0], fields, strict=False):
        values = result[name]
        ax.set_title(f"{name}", loc="left", fontsize="small")
        ax.axhline(0.0, color="0.7", lw=0.6)
        dim, of = str(values.dims[0]), values.attrs["units"]
        if dim.startswith("point_"):
            fault = dim.removeprefix("point_")
            position, weight = result[f"position_{fault}"].values, result[f"weight_{fault}"]
            shown, style, length = values.values / weight.values, "-", weight.attrs["units"]
            label = f"per {'length' if length == 'm' else 'area'}\n({_per(of, length)})"
        else:
            position, shown, style, label = result[dim].values, values.values, "o-", f"per knot\n({of})"
        size, unit = scale(position, "m")
        ax.plot(position / size, shown, style, ms=3, lw=1.0)
        ax.set_ylabel(label)
        ax.set_xlabel(f"Position ({unit})" if ax is axes[len(fields) - 1, 0] else "")
    if not fields:
        axes[0, 0].bar(np.arange(len(numbers)), [float(result[name]) for name in numbers])
        axes[0, 0].set_xticks(np.arange(len(numbers)), numbers, rotation=20, ha="right")
        axes[0, 0].set_ylabel(f"derivative ({result['objective'].attrs['units']} per unit)")
    unit = result["objective"].attrs["units"]
    value = f"{float(result['objective']):.6g}" + (f" {unit}" if unit != "1" else "")
    figure.suptitle(f"Derivative of the objective, which is {value}")
    return figure


def _per(unit: str, length: str) -> str:
    """Return the unit of a derivative per length or area."""
    above, _, below = unit.partition("/")
    return f"{above}/({below.strip('()')} {length})" if below else f"{above}/{length}"
