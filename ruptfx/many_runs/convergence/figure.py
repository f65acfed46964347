"""Figure of a convergence: error over spacing, and the relative error bars of all numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ruptfx.results.figure_style import MUTED, STEADY, STICK_SLIP, letter, new_figure, note, remark, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ruptfx.many_runs.convergence.estimates import Row

LINES, BARS = 6, 24  # most lines and most bars


@styled
def draw(rows: Sequence[Row], spacings: Mapping[str, list[float]]) -> Figure:
    """Draw (a) the distance of numbers from their extrapolated value over the spacing, (b) bars relative to values."""
    shown = [row for row in rows if row.value != 0 and row.bar > 0][:BARS]
    figure, axes = new_figure(1, 2, max(2.6, 0.7 + 0.15 * len(shown)), width_ratios=(1, 0.8))
    _errors(axes[0, 0], rows, spacings)
    _bars(axes[0, 1], shown)
    letter(axes[0])
    omitted = len(rows) - len(shown)
    remark(figure, f"{omitted} more numbers are in converge.csv: zero, the same on all levels, or no place."
           if omitted else "")  # fmt: skip
    return figure


def _errors(ax: Axes, rows: Sequence[Row], spacings: Mapping[str, list[float]]) -> None:
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="Spacing over that of the case",
        ylabel="Distance from the extrapolated value",
    )
    (family, factors), *_ = spacings.items()
    inside = [row for row in rows if not row.by[family].outside and row.by[family].order and row.value != 0]
    for row in sorted(inside, key=lambda row: -row.bar / abs(row.value))[:LINES]:
        each = row.by[family]
        assert each.order is not None
        errors = np.abs((np.array(each.values) - each.extrapolated) / each.extrapolated)
        ax.plot(factors, errors, "o-", ms=3, label=f"{row.name.replace('_', ' ')}, order {each.order:.2g}")
    if not inside:
        note(ax, "no number is in the asymptotic range")
        return
    low = ax.get_ylim()[0]
    for order in (1, 2):
        ax.plot(factors, low * np.array(factors) ** order, ":", color=MUTED, lw=0.8)
        ax.annotate(f"{order}", (factors[-1], low * factors[-1] ** order), color=MUTED, fontsize=6)
    ax.set_xticks(factors, [f"{factor:g}" for factor in factors], minor=False)
    ax.minorticks_off()
    ax.set_box_aspect(None)
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.06), ncols=1)


def _bars(ax: Axes, rows: Sequence[Row]) -> None:
    ax.set(xscale="log", xlabel="Error bar over value", ylim=(len(rows) - 0.5, -0.5))
    if not rows:
        note(ax, "no number that every level has")
        return
    for inside, colour, label in ((True, STEADY, "asymptotic range"), (False, STICK_SLIP, "not in it")):
        places = [i for i, row in enumerate(rows) if (not row.outside) == inside and row.bar > 0]
        shares = [rows[i].bar / abs(rows[i].value) for i in places]
        if places:
            ax.plot(shares, places, "o", ms=4, color=colour, mfc=colour if inside else "white", label=label)
    ax.set_yticks(range(len(rows)), [row.name.replace("_", " ") for row in rows])
    ax.grid(axis="y", lw=0.3, color=MUTED, alpha=0.4)
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.06), ncols=2)
