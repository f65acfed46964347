"""Figure of an inference: data and fit trace by trace, recovered unknowns, and misfit against iteration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.figure_style import ACCENT, GUIDE, MUTED, STICK_SLIP, blank_figure, known_unit, letter, scale, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ruptfx.inference.result import Fit, Recovered, Result

Floats = NDArray[np.float64]
MOST_TRACES = 40


@styled
def draw(made: Result) -> Figure:
    """Return the figure.

    Parameters
    ----------
    made : Result
        Result of `ruptfx.infer`.
    """
    fields = [each for each in made.unknowns if each.shape == "field"]
    numbers = [each for each in made.unknowns if each.shape == "number"]
    right = len(fields) + bool(numbers) + 1
    height = max(1.7 * right, min(0.16 * len(made.fits) + 1.0, 6.0))
    figure = blank_figure(7.0, height)
    grid = figure.add_gridspec(right, 2, width_ratios=(1, 1.2))
    left = figure.add_subplot(grid[:, 0])
    _draw_fits(left, made.fits)
    panels = [left]
    for number, each in enumerate(fields):
        panels.append(figure.add_subplot(grid[number, 1]))
        _draw_field(panels[-1], each)
    if numbers:
        panels.append(figure.add_subplot(grid[len(fields), 1]))
        _draw_numbers(panels[-1], numbers)
    panels.append(figure.add_subplot(grid[right - 1, 1]))
    _draw_misfit(panels[-1], made)
    letter(panels)
    return figure


def _draw_fits(ax: Axes, fits: list[Fit]) -> None:
    """Draw traces above each other, of equal height where their amplitudes are alike."""
    if not fits:
        ax.text(0.5, 0.5, "no traces", ha="center", va="center", color=MUTED)
        ax.set_axis_off()
        return
    shown = fits[:: -(-len(fits) // MOST_TRACES)]
    size, unit = scale(np.concatenate([each.times for each in shown]), "s")
    height = max(float(np.ptp(each.data)) for each in shown) or 1.0
    for row, each in enumerate(shown):
        hidden, times = "_" * bool(row), each.times / size

        def placed(values: Floats, offset: float = -row, first: float = float(each.data[0])) -> Floats:
            return offset + (values - first) / height

        ax.plot(times, placed(each.start), color=MUTED, lw=0.6, ls=":", label=f"{hidden}case")
        ax.plot(times, placed(each.data), ".", color="k", ms=1.5, label=f"{hidden}data")
        ax.plot(times, placed(each.best), color=STICK_SLIP, lw=0.8, label=f"{hidden}fit")
    step = -(-len(shown) // 30)
    ax.set_yticks(-np.arange(0, len(shown), step), [each.name for each in shown[::step]], fontsize=5)
    ax.set(xlabel=f"Time ({unit})")
    ax.legend(loc="lower center", bbox_to_anchor=(0.6, 1.0), ncols=3)


def _draw_field(ax: Axes, each: Recovered) -> None:
    order = np.argsort(each.position)
    along, unit = scale(each.position, "m")
    size, of = scale(each.best, each.unit) if known_unit(each.unit) else (1.0, each.unit)
    x = each.position[order] / along
    ax.fill_between(x, each.band[0][order] / size, each.band[1][order] / size, color=ACCENT, alpha=0.25, lw=0,
                    label="prior")  # fmt: skip
    ax.plot(x, each.start[order] / size, color=MUTED, ls=":", label="case")
    ax.plot(x, each.best[order] / size, color=STICK_SLIP, label="recovered")
    ax.set(xlabel=f"Position ({unit})", ylabel=f"{each.key.rpartition('.')[2]} ({of})", xlim=(x[0], x[-1]))
    ax.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


def _draw_numbers(ax: Axes, numbers: list[Recovered]) -> None:
    changes = [float(each.best.mean() / each.start.mean()) if each.start.mean() else np.nan for each in numbers]
    ax.axhline(1.0, color=MUTED, lw=0.6)
    ax.plot(np.arange(len(numbers)), changes, "o", color=STICK_SLIP)
    names = [each.key.partition(".")[2].partition(".")[2] for each in numbers]
    ax.set_xticks(np.arange(len(numbers)), names, fontsize=6)
    ax.set(ylabel="recovered / case", xlim=(-0.5, len(numbers) - 0.5))


def _draw_misfit(ax: Axes, made: Result) -> None:
    misfit = np.array([made.runs[number].misfit for number in made.iterates])
    if made.data:
        misfit = 2 * misfit / made.data
        ax.axhline(1.0, color=GUIDE, lw=0.8, ls="--", label="noise")
    ax.plot(np.arange(len(misfit)), misfit, "o-", ms=2.5, color="k", label="misfit")
    if misfit.max() > 20 * misfit.min() > 0:
        ax.set_yscale("log")
    ax.set(xlabel="Iteration", ylabel="Misfit over that of noise" if made.data else "Misfit")
    ax.legend()
