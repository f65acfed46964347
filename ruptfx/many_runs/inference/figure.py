"""Figures of an inference: data and fit trace by trace, recovered unknowns and misfits; trade-offs between numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.results.figure_style import (
    ACCENT,
    GUIDE,
    MUTED,
    STICK_SLIP,
    blank_figure,
    known_unit,
    letter,
    scale,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ruptfx.many_runs.inference.result import Fit, Recovered, Result

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
    fields = [each for each in made.unknowns if each.shape != "number"]
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
    if len({each.unit for each in shown}) == 1 and (shown[0].unit == "1" or known_unit(shown[0].unit)):
        _draw_height(ax, height, shown[0].unit)
    step = -(-len(shown) // 30)
    ax.set_yticks(-np.arange(0, len(shown), step), [each.name for each in shown[::step]], fontsize=5)
    ax.set(xlabel=f"Time ({unit})")
    ax.legend(loc="lower center", bbox_to_anchor=(0.6, 1.0), ncols=3)


def _draw_height(ax: Axes, height: float, unit: str) -> None:
    """Draw a bar of a round number of units, where traces have `height` in a row of height one."""
    size, printed = (1.0, "") if unit == "1" else scale(height, unit)
    power = 10.0 ** np.floor(np.log10(0.8 * height / size))
    length = power * max(each for each in (1, 2, 5) if each * power <= 0.8 * height / size)
    top = ax.get_ylim()[1]
    ends = np.array([top - length * size / height, top])
    ax.plot([1.02, 1.02], ends, color="k", lw=1.5, transform=ax.get_yaxis_transform(), clip_on=False, label="_height")
    ax.text(1.03, ends.mean(), f"{length:g} {printed}".strip(), transform=ax.get_yaxis_transform(), rotation=90,
            va="center", fontsize=6)  # fmt: skip
    ax.set_ylim(ax.get_ylim()[0], top)


def _draw_field(ax: Axes, each: Recovered) -> None:
    order = np.argsort(each.position)
    along, unit = scale(each.position, "m")
    size, of = scale(each.best, each.unit) if known_unit(each.unit) else (1.0, each.unit)
    x = each.position[order] / along
    if np.any(np.ptp(each.band, axis=0)):  # knots may have no prior
        ax.fill_between(x, each.band[0][order] / size, each.band[1][order] / size, color=ACCENT, alpha=0.25, lw=0,
                        label="prior")  # fmt: skip
    if each.interval is not None:
        ax.fill_between(x, each.interval[0][order] / size, each.interval[1][order] / size, color=STICK_SLIP, alpha=0.3,
                        lw=0, label="68 %")  # fmt: skip
    ax.plot(x, each.start[order] / size, color=MUTED, ls=":", label="case")
    ax.plot(x, each.best[order] / size, color=STICK_SLIP, label="recovered")
    ax.set(xlabel=f"Position ({unit})", ylabel=f"{each.key.rpartition('.')[2]} ({of})", xlim=(x[0], x[-1]))
    ax.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


def _draw_numbers(ax: Axes, numbers: list[Recovered]) -> None:
    """Write the numbers with their intervals and units, and what the case had."""
    ax.set_axis_off()
    rows = [("", "recovered", "68 %", "case", "")]
    for each in numbers:
        start, best = each.start.mean(), each.best.mean()
        ends = np.array([np.nan, np.nan]) if each.interval is None else each.interval.mean(axis=1)
        size, unit = scale(np.array([start, best]), each.unit) if known_unit(each.unit) else (1.0, each.unit)
        interval = "" if each.interval is None else " to ".join(f"{end / size:.4g}" for end in ends)
        name = each.key.partition(".")[2].partition(".")[2] or each.key
        rows.append((name, f"{best / size:.4g}", interval, f"{start / size:.4g}", unit if unit != "1" else ""))
    for number, row in enumerate(rows):
        colours = ["k", STICK_SLIP, "k", MUTED, "k"] if number else [MUTED] * 5
        for x, text, colour in zip((0.0, 0.3, 0.45, 0.82, 0.94), row, colours, strict=True):
            ax.text(x, 1 - (number + 0.5) / max(len(rows), 4), text, color=colour, fontsize=6, va="center")


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


@styled
def draw_tradeoffs(made: Result) -> Figure:
    """Return the figure of samples of the posterior, for every number and every pair of them.

    Parameters
    ----------
    made : Result
        Result of `ruptfx.infer` with samples of at least two numbers.
    """
    numbers = [each for each in made.unknowns if each.key in made.samples]
    n = len(numbers)
    figure = blank_figure(1.2 + 1.5 * n, 0.6 + 1.4 * n)
    grid = figure.add_gridspec(n, n)
    sizes = [scale(made.samples[each.key], each.unit) if known_unit(each.unit) else (1.0, each.unit)
             for each in numbers]  # fmt: skip
    for row, below in enumerate(numbers):
        y = made.samples[below.key] / sizes[row][0]
        for column, left in enumerate(numbers[: row + 1]):
            x = made.samples[left.key] / sizes[column][0]
            ax = figure.add_subplot(grid[row, column])
            if row == column:
                ax.hist(x, bins=40, color=ACCENT, alpha=0.5, density=True)
                if left.interval is not None:
                    ax.axvspan(*(left.interval.mean(axis=1) / sizes[column][0]), color=STICK_SLIP, alpha=0.15, lw=0)
                ax.axvline(left.best.mean() / sizes[column][0], color=STICK_SLIP)
                ax.set_yticks([])
            else:
                ax.plot(x, y, ".", color=ACCENT, ms=1.5, alpha=0.3, rasterized=True)
                ax.plot(left.best.mean() / sizes[column][0], below.best.mean() / sizes[row][0], "o", color=STICK_SLIP,
                        ms=3)  # fmt: skip
                ax.set_ylim(*_most(y))
            ax.set_xlim(*_most(x))
            ax.set(xlabel=_labelled(left, sizes[column][1]) if row == n - 1 else "",
                   ylabel=_labelled(below, sizes[row][1]) if column == 0 < row else "")  # fmt: skip
            ax.tick_params(labelsize=5, labelbottom=row == n - 1, labelleft=column == 0 < row)
    return figure


def _most(values: Floats) -> tuple[float, float]:
    """Return the limits of an axis that shows almost all samples."""
    low, high = np.quantile(values, [0.002, 0.998])
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _labelled(each: Recovered, unit: str) -> str:
    return each.key.rpartition(".")[2] + (f" ({unit})" if unit not in ("", "1") else "")
