"""Map of a study: its mode over two axes, with speeds, slip and energy; as a figure and as an HTML page.

The page is one file without dependencies, so that it works from a disk or an attachment: a pointer over a point shows
its numbers, a click its pictures, summary and the command that runs it again, and buttons select the coloured
quantity. Only the link to the files of a point needs the study directory.
"""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from ruptfx import RuptfxError, Table
from ruptfx.many_runs.study.definition import Axis, Study
from ruptfx.many_runs.study.harvest import PICTURES
from ruptfx.many_runs.study.table import Row, read_csv, unit_of
from ruptfx.results.figure_style import MUTED, WIDTH, letter, new_figure, note, scale, styled

MODES = {
    "crack": ("#0072B2", "s"), "pulse": ("#E69F00", "^"), "train": ("#D55E00", "D"), "mixed": ("#009E73", "o"),
    "sub-Rayleigh": ("#0072B2", "s"), "sub-shear": ("#56B4E9", "v"), "supershear": ("#D55E00", "^"),
    "arrested": ("#8a8a8a", "x"), "none": ("#e2e2e2", "."), "not resolved": ("#e8d5b0", "$?$"),
    "failed": ("#ffffff", "$!$"),
}  # fmt: skip
"""Colour and symbol of every mode; the colours are told apart by the colour blind too."""
OTHERS = [("#CC79A7", "v"), ("#56B4E9", "P"), ("#F0E442", "*"), ("#332288", "h")]
COLOURS = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.08, 1, 256)))


@dataclass(frozen=True)
class Quantity:
    """A quantity that colours the map: column of the table, label, unit of the axis, size of that unit."""

    name: str
    label: str
    unit: str = ""
    size: float = 1.0


QUANTITIES = (
    Quantity("tip_speed_over_c_l", "Tip speed / c_l"),
    Quantity("peak_slip_rate", "Peak slip rate", "m/s"),
    Quantity("max_slip", "Largest slip", "m"),
    Quantity("frictional_dissipation_share", "Work dissipated by friction", "%", 0.01),
)
OF_ANTIPLANE = Quantity("tip_speed_over_c_s", "Tip speed / c_s")
SHARES = {
    "kinetic_share": "kinetic", "strain_share": "strain", "interface_elastic_share": "interface",
    "frictional_dissipation_share": "friction", "damping_share": "damping",
}  # fmt: skip


@dataclass(frozen=True)
class Map:
    """A study and its table, as input of the map."""

    study: Study
    rows: list[Row]
    directory: Path

    @property
    def axes(self) -> list[Axis]:
        """First two numeric axes: horizontal and vertical."""
        axes = [axis for axis in self.study.axes if axis.numeric][:2]
        if not axes:
            names = ", ".join(axis.column for axis in self.study.axes)
            raise RuptfxError(
                f"{self.directory}: a map needs an axis with numbers, and the axes ({names}) have names; read table.csv"
            )
        return axes

    @property
    def facets(self) -> list[tuple[str, list[Row]]]:
        """Rows grouped by the values of the remaining axes; a hypercube is one group."""
        other_axes = [a for a in self.study.axes if a not in self.axes and a not in self.study.sampled]
        groups: dict[str, list[Row]] = {}
        for row in self.rows:
            label = ", ".join(_value(axis, row[axis.column]) for axis in other_axes)
            groups.setdefault(label, []).append(row)
        return list(groups.items())

    @property
    def quantities(self) -> list[Quantity]:
        """The default quantities that the table has; else its first four numbers."""
        usual = (OF_ANTIPLANE, *QUANTITIES[1:]) if self.antiplane else QUANTITIES
        has = [q for q in usual if any(isinstance(row.get(q.name), float) for row in self.rows)]
        if has:
            return [self._in_a_good_unit(quantity) for quantity in has]
        skip = {*(axis.column for axis in self.study.axes), "seconds", "run_time"}
        names = [n for n in (self.rows[0] if self.rows else {}) if n not in skip]
        names = [n for n in names if any(isinstance(row[n], float) for row in self.rows)]
        return [Quantity(name, name.replace("_", " ")) for name in names[:4]]

    @property
    def panels(self) -> list[Quantity | None]:
        """Quantities of the map, one panel each: None for the mode, and numbers."""
        return [*([None] if self.has_modes else []), *self.quantities]

    @property
    def antiplane(self) -> bool:
        """True if only shear waves exist, so that the recorded c_l equals c_s."""
        pairs = [(row.get(QUANTITIES[0].name), row.get(OF_ANTIPLANE.name)) for row in self.rows]
        known = [pair for pair in pairs if all(isinstance(value, float) for value in pair)]
        return bool(known) and all(over_c_l == over_c_s for over_c_l, over_c_s in known)

    def _in_a_good_unit(self, quantity: Quantity) -> Quantity:
        if quantity.unit != "m":
            return quantity
        size, unit = scale(np.array([_number(row.get(quantity.name)) for row in self.rows]), "m")
        return replace(quantity, unit=unit, size=size)

    @property
    def has_modes(self) -> bool:
        """True if the table has a mode or a failure in any row."""
        return any(isinstance(row.get(self.study.refine.by), str) or row["status"] == "failed" for row in self.rows)

    def mode(self, row: Row) -> str:
        """Return the mode of a row, or "failed"."""
        return "failed" if row["status"] == "failed" else str(row.get(self.study.refine.by) or "none")

    def look(self) -> dict[str, tuple[str, str]]:
        """Return colour and symbol of the modes that occur."""
        names = {self.mode(row) for row in self.rows}
        others = sorted(names - MODES.keys())
        extra = {name: OTHERS[i % len(OTHERS)] for i, name in enumerate(others)}
        return {name: look for name, look in {**MODES, **extra}.items() if name in names}

    def doubtful(self, row: Row) -> bool:
        """Return whether half the threshold or the finer mesh gives another mode."""
        others = [row.get("mode_at_half_threshold"), row.get("fine_mesh")]
        return self.study.refine.by == "mode" and any(o is not None and o != row.get("mode") for o in others)


def read_map(directory: str | Path) -> Map:
    """Read the map of a study directory.

    Raises
    ------
    RuptfxError
        No finished study is there.
    """
    directory = Path(directory)
    try:
        study = Study.model_validate(json.loads((directory / "study.json").read_text())["study"])
        return Map(study, read_csv(directory / "table.csv"), directory)
    except (OSError, ValueError, KeyError) as error:
        raise RuptfxError(
            f"{directory}: no finished study is there ({error}); give the directory that 'ruptfx study' wrote"
        ) from None


def suits(shown: Map) -> bool:
    """Return whether there is a numeric axis and a quantity for the map."""
    return any(axis.numeric for axis in shown.study.axes) and bool(shown.panels)


def save(directory: str | Path, formats: Sequence[str] = ("png", "pdf"), out: str | Path | None = None) -> list[Path]:
    """Draw the map of a study directory as figure and page, there or into `out`; return the files.

    Raises
    ------
    RuptfxError
        If there is no finished study, or its table has no quantity for the map.
    """
    directory = Path(directory)
    shown = read_map(directory)
    if not shown.panels:
        raise RuptfxError(f"{directory}: the table has neither modes nor numbers to draw; name numbers in quantities")
    figure = draw(shown)
    out = directory if out is None else Path(out)
    paths = [out / f"mode_map.{kind}" for kind in formats]
    for path in paths:
        figure.savefig(path, dpi=200)
    whole = out / "mode_map.html"
    whole.write_text(page(shown), encoding="utf-8")
    return [*paths, whole]


@styled
def draw(shown: Map) -> Figure:
    """Draw the mode and four quantities, one row each, one column per value of the remaining axes.

    Hollow symbols: half the sliding threshold or, with `--refine`, the finer mesh gives another mode.
    """
    facets = shown.facets[:4]
    kinds = shown.panels
    if len(facets) == 1:  # panels side by side
        columns = min(len(kinds), 2)
        figure, grid = new_figure(-(-len(kinds) // columns), columns, 2.55 * -(-len(kinds) // columns), WIDTH)
        cells = [(grid.flat[k], kind, facets[0][1], "") for k, kind in enumerate(kinds)]
        for ax in grid.flat[len(kinds) :]:
            ax.set_axis_off()
    else:
        figure, grid = new_figure(len(kinds), len(facets), 2.3 * len(kinds), max(WIDTH * len(facets) / 2, WIDTH))
        cells = [
            (grid[i, j], kind, rows, label) for i, kind in enumerate(kinds) for j, (label, rows) in enumerate(facets)
        ]
    for ax, quantity, rows, label in cells:
        _axes(ax, shown)
        if quantity is None:
            _draw_modes(ax, shown, rows)
        else:
            _draw_quantity(ax, shown, rows, quantity)
        _draw_marks(ax, shown, named=quantity is kinds[0])
        ax.set_title(label, parse_math=False)
    letter([ax for ax, *_ in cells])
    if shown.has_modes:
        _legend(figure, shown.look())
    return figure


@styled
def draw_modes(maps: Sequence[Map]) -> Figure:
    """Draw only the modes of several studies side by side; the axes should be the same."""
    panels = [(shown, label, rows) for shown in maps for label, rows in shown.facets]
    figure, grid = new_figure(1, len(panels), 2.5, max(WIDTH, 2.4 * len(panels)), sharey=True)
    for ax, (shown, label, rows) in zip(grid[0], panels, strict=True):
        _axes(ax, shown)
        _draw_modes(ax, shown, rows)
        _draw_marks(ax, shown)
        ax.set_title(label or shown.study.title, parse_math=False)
        ax.label_outer()
    letter(grid[0])
    entries = {name: look for shown in maps for name, look in shown.look().items()}
    _legend(figure, {name: entries[name] for name in (*MODES, *(entries.keys() - MODES.keys())) if name in entries})
    return figure


def _legend(figure: Figure, look: dict[str, tuple[str, str]]) -> None:
    outline: Table = {"ls": "", "mec": MUTED, "mew": 0.4, "ms": 6}
    handles = [Line2D([], [], marker="s", color=colour, label=name, **outline) for name, (colour, _) in look.items()]
    legend = figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), handletextpad=0.1)
    for text in legend.get_texts():
        text.set_parse_math(False)


def _axes(ax: Axes, shown: Map) -> None:
    for name, axis in zip("xy", shown.axes, strict=False):
        size, unit = _unit(axis)
        values = np.array([row[axis.column] for row in shown.rows]) / size
        logarithmic = axis.spacing == "log"
        if logarithmic:
            getattr(ax, f"set_{name}scale")("log")
            low, high = np.floor(np.log10(values.min())), np.ceil(np.log10(values.max()))
            ticks = [t for e in np.arange(low, high + 1) for t in (10**e, 2 * 10**e, 5 * 10**e)]
            ticks = [t for t in ticks if 0.99 * values.min() <= t <= 1.01 * values.max()]
            getattr(ax, f"set_{name}ticks")(ticks, [f"{t:g}" for t in ticks])
            getattr(ax, f"{name}axis").minorticks_off()
        text = (axis.label or axis.column) + (f" ({unit})" if unit not in ("", "1") else "")
        getattr(ax, f"set_{name}label")(text, parse_math=False)
    ax.tick_params(top=False, right=False, direction="out")


def _unit(axis: Axis) -> tuple[float, str]:
    """Return size and name of the unit on an axis: Pa becomes MPa."""
    values = axis.range or axis.labels or axis.values or []
    try:
        return scale(np.array(values), axis.unit)
    except KeyError:
        return 1.0, axis.unit


def _value(axis: Axis, value: object) -> str:
    """Return name, value and unit of an axis as text; names of values stand alone."""
    if isinstance(value, str):
        return value
    return f"{axis.column} = {_text(value)}" + f" {axis.unit}" * (axis.unit not in ("", "1"))


def _coordinates(shown: Map, rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray]:
    places = [np.array([row[a.column] for row in rows]) / _unit(a)[0] for a in shown.axes]
    return places[0], places[1] if len(places) > 1 else np.zeros(len(rows))


def _cells(ax: Axes, shown: Map, rows: Sequence[Row], values: Sequence[object] | np.ndarray, **style: Any) -> None:
    """Colour one cell per point of the grid; a cloud of dots for a hypercube and for refined points."""
    x, y = _coordinates(shown, rows)
    grid = np.array([row["origin"] == "sample" for row in rows]) & (not shown.study.sampled)
    colours = np.array(values, dtype=float)
    if grid.any():
        xs, ys = np.unique(x[grid]), np.unique(y[grid])
        table = np.full((len(ys), len(xs)), np.nan)
        table[np.searchsorted(ys, y[grid]), np.searchsorted(xs, x[grid])] = colours[grid]
        logs = [axis.spacing == "log" for axis in shown.axes] + [False]
        ax.pcolormesh(_edges(xs, logs[0]), _edges(ys, logs[1]), table, edgecolors="white", linewidth=0.6, **style)
    if not grid.all():
        size = 22 if shown.study.sampled else 9
        ax.scatter(x[~grid], y[~grid], size, colours[~grid], edgecolors="white", linewidths=0.4, zorder=3, **style)


def _edges(values: np.ndarray, logarithmic: bool) -> np.ndarray:
    """Return edges half-way between neighbours; outer cells are symmetric, but stay positive for positive values."""
    v = np.log(values) if logarithmic else values
    if len(v) == 1:
        edges = np.array([v[0] - 0.5, v[0] + 0.5])
    else:
        mid = (v[1:] + v[:-1]) / 2
        edges = np.concatenate([[2 * v[0] - mid[0]], mid, [2 * v[-1] - mid[-1]]])
    if logarithmic:
        return np.exp(edges)
    if values[0] >= 0:
        edges[0] = max(edges[0], 0.0)
    return edges


def _draw_modes(ax: Axes, shown: Map, rows: Sequence[Row]) -> None:
    look = shown.look()
    names = list(look)
    numbers = [names.index(shown.mode(row)) for row in rows]
    colours = ListedColormap([colour for colour, _ in look.values()])
    _cells(ax, shown, rows, numbers, cmap=colours, norm=Normalize(-0.5, len(names) - 0.5))
    kept = [row for row in rows if row["origin"] == "sample" and not shown.study.sampled]
    x, y = _coordinates(shown, kept)
    for name, (colour, marker) in look.items():
        ink = "#555555" if name in ("none", "failed", "arrested", "not resolved") else "white"
        for hollow in (False, True):
            chosen = np.array([shown.mode(r) == name and shown.doubtful(r) == hollow for r in kept], dtype=bool)
            style: Table = {"mfc": colour if hollow else ink, "mec": ink, "mew": 0.8, "ms": 3.6, "ls": "", "zorder": 4}
            ax.plot(x[chosen], y[chosen], marker=marker, **style)


def _draw_quantity(ax: Axes, shown: Map, rows: Sequence[Row], quantity: Quantity) -> None:
    values = np.array([_number(row.get(quantity.name)) for row in rows]) / quantity.size
    everything = np.array([_number(row.get(quantity.name)) for row in shown.rows]) / quantity.size
    good = everything[np.isfinite(everything)]
    if not len(good):
        note(ax, "no value")
        return
    low, high = float(good.min()), float(good.max())
    positive = good[good > 0]
    logarithmic = len(positive) > 0 and low >= 0 and high > 30 * max(float(np.quantile(positive, 0.05)), 1e-300)
    extend = "neither"
    if logarithmic:
        low = max(float(positive.min()), high / 1e4)
        extend = "min" if positive.min() < low else "neither"
    norm = LogNorm(low, high) if logarithmic else Normalize(low, high if high > low else low + 1)
    # Values more than four decades below the largest have the last colour; zero has none.
    shades = np.where(values > 0, np.maximum(values, low), np.nan) if logarithmic else values
    _cells(ax, shown, rows, shades, cmap=COLOURS, norm=norm)
    ax.set_facecolor("#f2f2f2")
    label = quantity.label + (f" ({quantity.unit})" if quantity.unit else "")
    bar = ax.figure.colorbar(
        ScalarMappable(norm, COLOURS), ax=ax, label=re.sub("c_[ls]", r"$\g<0>$", label), pad=0.02, extend=extend
    )
    bar.ax.tick_params(direction="out")
    if logarithmic:
        bar.ax.yaxis.set_major_formatter("{x:g}")


def _draw_marks(ax: Axes, shown: Map, named: bool = True) -> None:
    """Draw circles around marked points, and their names on the line between two rows of cells, which have symbols."""
    if len(shown.axes) < 2:
        return
    for mark in shown.study.marks:
        point = [value / _unit(axis)[0] for value, axis in zip(mark.point, shown.axes, strict=True)]
        ax.plot(*point, "o", ms=8, mfc="none", mec="black", mew=1.0, zorder=5)
        if not named:
            continue
        ax.autoscale_view()  # transforms need axis limits
        across = (ax.transData - ax.transAxes).transform(point)[0]
        # Inside of the map at its sides, else at the common corner of four cells.
        place, way = ("left", 6) if across < 0.25 else ("right", -6) if across > 0.75 else ("center", 0)
        up = 9 if shown.study.sampled else 0
        x, y = (_edge_beside(shown, axis, value) for axis, value in zip(shown.axes, point, strict=True))
        halo = [withStroke(linewidth=1.5, foreground="white")]
        ax.annotate(
            mark.label,
            (x if place == "center" else point[0], y),
            (way, up),
            textcoords="offset points",
            ha=place,
            va="center",
            fontsize=6,
            fontweight="bold",
            zorder=6,
            path_effects=halo,
            parse_math=False,
            gid="mark",
        )


def _edge_beside(shown: Map, axis: Axis, value: float) -> float:
    """Return the edge of cells above a value of an axis; in the last cell the one below, without cells the value."""
    grid = [] if shown.study.sampled else [row[axis.column] for row in shown.rows if row["origin"] == "sample"]
    if not grid:
        return value
    values = np.unique(grid) / _unit(axis)[0]
    inner = _edges(values, axis.spacing == "log")[1:-1]
    above = inner[inner > value]
    return float(above[0] if len(above) else inner[-1] if len(inner) else value)


def page(shown: Map) -> str:
    """Return the HTML page: the template with all data and pictures."""
    units = [_unit(axis) for axis in shown.axes]
    axes = [
        {"label": a.label or a.column, "unit": "" if unit == "1" else unit, "size": size, "log": a.spacing == "log"}
        for a, (size, unit) in zip(shown.axes, units, strict=True)
    ]
    look, title = shown.look(), shown.study.title or shown.directory.name
    plane = shown.study.plane
    names = {name: unit_of(name, plane) for name in (shown.rows[0] if shown.rows else {})}
    names |= {axis.column: axis.unit for axis in shown.study.axes}
    facets = [{"label": label, "points": [_page_point(shown, row) for row in rows]} for label, rows in shown.facets]
    data = {
        "title": title, "axes": axes, "by": shown.study.refine.by,
        "modes": {name: colour for name, (colour, _) in look.items()} if shown.has_modes else None,
        "quantities": [vars(q) for q in shown.quantities], "shares": SHARES, "pictures": PICTURES,
        "units": {name: unit for name, unit in names.items() if unit != "1"},
        "marks": [mark.model_dump() for mark in shown.study.marks] if len(axes) > 1 else [],
        "cloud": bool(shown.study.sampled),
        "colours": [matplotlib.colors.to_hex(COLOURS(part)) for part in np.linspace(0, 1, 33)],
        "facets": facets,
    }  # fmt: skip
    template = files("ruptfx.many_runs.study").joinpath("mode_map.html").read_text(encoding="utf-8")
    # "</script>" and "<!--" would change where the script element that holds the data ends.
    text = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    # In one pass: a title that reads like a placeholder stays a title.
    blanks = {"/*TITLE*/": html.escape(title), "/*DATA*/null": text}
    return re.sub("|".join(map(re.escape, blanks)), lambda result: blanks[result[0]], template)


def _page_point(shown: Map, row: Row) -> Table:
    x, y = _coordinates(shown, [row])
    directory = shown.directory / "points" / str(row["point"])
    saved = {name: directory / f"{name}.webp" for name in PICTURES}
    pictures = {name: base64.b64encode(f.read_bytes()).decode() for name, f in saved.items() if f.is_file()}
    return {
        "x": float(x[0]), "y": float(y[0]), "mode": shown.mode(row), "doubtful": shown.doubtful(row),
        "row": {key: _json(value) for key, value in row.items() if value is not None},
        "pictures": pictures, "command": _command(shown, row),
    }  # fmt: skip


def _command(shown: Map, row: Row) -> str:
    """Return the command that runs a point again in the study directory; empty if its case is missing."""
    case = Path("points", str(row["point"]), "case.toml")
    if not (shown.directory / case).is_file():
        return ""
    figures = " --set output.figures=true" if "[output]" in (shown.directory / case).read_text(encoding="utf-8") else ""
    return f"ruptfx run {case} --out runs/{row['point']}{figures}"


def _json(value: object) -> object:
    """Replace an infinite number, which JSON does not have, by its name."""
    return value if not isinstance(value, float) or np.isfinite(value) else str(value)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
