"""The numbers of a study over its only axis, each with its standard error where the table has one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ruptfx.figure_style import GUIDE, WIDTH, known_unit, letter, new_figure, scale, styled
from ruptfx.study.mode_map import Map
from ruptfx.study.table import TIMINGS, Row, unit_of

COLUMNS = 3
ERROR, SHARE = "_error", "_share"
COLOURS = ("#c0392b", "#2a6099", "#8e44ad", "#7f8c8d", "#d35400", "#16a085")


def suits(shown: Map) -> bool:
    """Whether there is one axis with numbers, and no mode that a map would show better."""
    numeric = [axis for axis in shown.study.axes if axis.numeric]
    return len(numeric) == 1 == len(shown.study.axes) and not shown.has_modes and bool(shown.study.quantities)


def save(shown: Map, formats: Sequence[str] = ("png", "pdf")) -> list[Path]:
    """Draw the curves into the directory of the study; returns the files."""
    figure = draw(shown)
    paths = [shown.directory / f"curves.{kind}" for kind in formats]
    for path in paths:
        figure.savefig(path, dpi=200)
    return paths


@styled
def draw(shown: Map) -> Figure:
    """Every quantity that the study names in a panel of its own; all shares in one."""
    skip = {*TIMINGS, *(axis.column for axis in shown.study.axes)}
    names = [name for name in shown.study.quantities if name not in skip and not name.endswith(ERROR)]
    names = [name for name in names if any(isinstance(row.get(name), float) for row in shown.rows)]
    shares = [name for name in names if name.endswith(SHARE)]
    panels = [[name] for name in names if name not in shares] + ([shares] if shares else [])
    lines = max(math.ceil(len(panels) / COLUMNS), 1)
    figure, axes = new_figure(lines, COLUMNS, 1.75 * lines, WIDTH, sharex=True)
    rows = sorted(shown.rows, key=lambda row: float(row[shown.axes[0].column]))
    for ax, panel in zip(axes.flat, panels, strict=False):
        _panel(ax, shown, rows, panel)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    axis = shown.axes[0]
    unit = "" if axis.unit in ("", "1") else f" ({axis.unit})"
    for ax in axes.flat[max(len(panels) - COLUMNS, 0) : len(panels)]:
        ax.set_xlabel((axis.label or axis.column) + unit, parse_math=False)
        ax.tick_params(labelbottom=True)
    letter(axes.flat[: len(panels)])
    return figure


def _panel(ax: Axes, shown: Map, rows: list[Row], names: list[str]) -> None:
    x = [row[shown.axes[0].column] for row in rows]
    for number, name in enumerate(names):
        y, error = (np.array([_number(row.get(f"{name}{end}")) for row in rows]) for end in ("", ERROR))
        size, unit = scale(y[np.isfinite(y)], unit_of(name)) if known_unit(unit_of(name)) else (1.0, "")
        colour = COLOURS[number % len(COLOURS)] if len(names) > 1 else GUIDE
        label = name.removesuffix(SHARE if len(names) > 1 else "").replace("_", " ")
        ax.errorbar(x, y / size, np.where(np.isfinite(error), error, 0) / size, fmt="o-", ms=3, lw=0.8, color=colour,
                    capsize=2, label=label)  # fmt: skip
    text = "part of events" if len(names) > 1 else label + (f" ({unit})" if unit else "")
    ax.set_ylabel(text, fontsize=6.5, parse_math=False)
    if len(names) > 1:
        ax.legend(fontsize=6)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")
