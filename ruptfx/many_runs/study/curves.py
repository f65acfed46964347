"""Curves of the quantities of a study over its only axis, with standard errors from the table.

A second axis may repeat it with other seeds: then every draw is a point, the line is that of medians, and
`medians.csv` lists them with the smallest and largest draw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ruptfx.many_runs.study.definition import Axis
from ruptfx.many_runs.study.mode_map import Map
from ruptfx.many_runs.study.table import TIMINGS, Row, unit_of, write_csv
from ruptfx.results.figure_style import GUIDE, WIDTH, known_unit, letter, new_figure, remark, scale, styled

COLUMNS = 3
ERROR, SHARE = "_error", "_share"
COLOURS = ("#c0392b", "#2a6099", "#8e44ad", "#7f8c8d", "#d35400", "#16a085")


def suits(shown: Map) -> bool:
    """Return whether the study has one numeric axis besides draws, and no mode (which a map shows better)."""
    varied = _varied(shown)
    return len(varied) == 1 and varied[0].numeric and not shown.has_modes and bool(shown.study.quantities)


def _varied(shown: Map) -> list[Axis]:
    """Return the axes that are not seeds."""
    return [axis for axis in shown.study.axes if not axis.repeats]


def save(shown: Map, formats: Sequence[str] = ("png", "pdf"), out: Path | None = None) -> list[Path]:
    """Draw the curves into the directory of the study or `out`, with a table of medians where there are draws."""
    figure, out = draw(shown), out or shown.directory
    paths = [out / f"curves.{kind}" for kind in formats]
    for path in paths:
        figure.savefig(path, dpi=200)
    if len(shown.study.axes) > 1:
        paths.append(out / "medians.csv")
        write_csv(paths[-1], medians(shown))
    return paths


def medians(shown: Map) -> list[Row]:
    """Return the median, smallest and largest draw of every quantity, for every value of the axis.

    `draws` counts the finished runs, `NAME_draws` those with a value of the quantity.
    """
    column = _varied(shown)[0].column
    table: list[Row] = []
    for x, rows in _by_value(shown).items():
        line: Row = {column: x, "draws": sum(row["status"] != "failed" for row in rows)}
        for name in _names(shown):
            known = [value for row in rows if math.isfinite(value := _number(row.get(name)))]
            line[f"{name}_draws"] = len(known)
            spread = (_median(known), min(known), max(known)) if known else (None,) * 3
            line |= dict(zip((name, f"{name}_smallest", f"{name}_largest"), spread, strict=True))
        table.append(line)
    return table


def _names(shown: Map) -> list[str]:
    """Return the quantities of the study with a value in any run, without those that are errors of others."""
    skip = {*TIMINGS, *(axis.column for axis in shown.study.axes)}
    names = [name for name in shown.study.quantities if name not in skip and not name.endswith(ERROR)]
    return [name for name in names if any(isinstance(row.get(name), float) for row in shown.rows)]


def _by_value(shown: Map) -> dict[float, list[Row]]:
    """Return the rows of every value of the axis, in the order of the axis."""
    column = _varied(shown)[0].column
    value: dict[float, list[Row]] = {}
    for row in sorted(shown.rows, key=lambda row: float(row[column])):
        value.setdefault(float(row[column]), []).append(row)
    return value


@styled
def draw(shown: Map) -> Figure:
    """Draw every quantity of the study in its own panel, all shares in one; the closure is a check and is left out."""
    names = [name for name in _names(shown) if name != "energy_closure"]
    shares = [name for name in names if name.endswith(SHARE)]
    panels = [[name] for name in names if name not in shares] + ([shares] if shares else [])
    lines = max(math.ceil(len(panels) / COLUMNS), 1)
    figure, axes = new_figure(lines, COLUMNS, 1.75 * lines, WIDTH, sharex=True)
    plane = shown.study.plane
    for ax, panel in zip(axes.flat, panels, strict=False):
        _panel(ax, _by_value(shown), panel, plane)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    (axis,) = _varied(shown)
    unit = "" if axis.unit in ("", "1") else f" ({axis.unit})"
    for ax in axes.flat[max(len(panels) - COLUMNS, 0) : len(panels)]:
        ax.set_xlabel((axis.label or axis.column) + unit, parse_math=False)
        ax.tick_params(labelbottom=True)
    letter(axes.flat[: len(panels)])
    if len(shown.rows) > len(_by_value(shown)):
        remark(figure, "Points are runs, lines the medians of runs with the same value.")
    return figure


def _panel(ax: Axes, by_value: dict[float, list[Row]], names: list[str], plane: str) -> None:
    rows = [row for each in by_value.values() for row in each]
    x = np.array([value for value, each in by_value.items() for _ in each])
    drawn = len(rows) > len(by_value)
    for number, name in enumerate(names):
        y, error = (np.array([_number(row.get(f"{name}{end}")) for row in rows]) for end in ("", ERROR))
        unit = unit_of(name, plane)
        size, unit = scale(y[np.isfinite(y)], unit) if known_unit(unit) else (1.0, "")
        colour = COLOURS[number % len(COLOURS)] if len(names) > 1 else GUIDE
        label = name.removesuffix(SHARE if len(names) > 1 else "").replace("_", " ")
        look = {"fmt": "o", "alpha": 0.45} if drawn else {"fmt": "o-", "label": label}
        bars = np.where(np.isfinite(error), error, 0) / size if np.isfinite(error).any() else None
        ax.errorbar(x, y / size, bars, ms=3, lw=0.8, color=colour, capsize=2,
                    **look)  # fmt: skip
        if drawn:
            middle = [_median(y[(x == value) & np.isfinite(y)]) / size for value in by_value]
            ax.plot(list(by_value), middle, color=colour, lw=1.2, label=label)
    text = label if label[1:2] == " " else label[:1].upper() + label[1:]  # "b value", and "Largest stress"
    text = "Part of events" if len(names) > 1 else text + (f" ({unit})" if unit else "")
    ax.set_ylabel(text, fontsize=6.5, parse_math=False)
    if len(names) > 1:
        low, high = ax.get_ylim()
        ax.set_ylim(top=high + 0.4 * (high - low))  # room for the legend, which hides no line there
        ax.legend(fontsize=6, loc="upper center", ncols=2)


def _median(values: Sequence[float] | np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")
