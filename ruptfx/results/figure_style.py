"""Common style of all figures: sizes, colours, units on axes, panel letters, remarks.

Figures are made without pyplot, so they need no display and leave no global state behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from io import BytesIO
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ruptfx.input.quantities import YEAR

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

Array = np.ndarray

WIDTH, ONE_COLUMN = 7.0, 3.5  # inch, two columns of a journal, and one
TICKS = 8  # of the longest axis in perspective
STYLE: Any = {
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
    "legend.frameon": False,
    "savefig.dpi": 200,
    "figure.dpi": 100,
    "pdf.fonttype": 42,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 20000,
    # Okabe and Ito (2008): told apart by readers with any colour vision.
    "axes.prop_cycle": cycler(color=["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"]),
}
OUTLYING = 3.0  # times the range of 98 % of the values: extremes beyond are cut off
GUIDE = "#1769aa"  # wave speeds
MUTED = "#888888"
REMARK_SIZE, REMARK_LETTER = 6.5, 0.045  # points, and inch that a letter takes on average
STICK_SLIP, STEADY, UNDECIDED, ACCENT = "#b5382a", "#2a6099", "#8a8a8a", "#e0a030"
# Perceptually uniform, without the ends in which lines and guides are invisible.
RATE_MAP = ListedColormap(matplotlib.colormaps["magma_r"](np.linspace(0.03, 0.9, 256)))
TIME_MAP = ListedColormap(matplotlib.colormaps["viridis_r"](np.linspace(0.12, 1, 256)))
WAVE_MAP = "inferno"

_PREFIXES = {
    "m": [(1e-12, "pm"), (1e-9, "nm"), (1e-6, "µm"), (1e-3, "mm"), (1.0, "m"), (1e3, "km")],
    "s": [(1e-6, "µs"), (1e-3, "ms"), (1.0, "s"), (YEAR, "yr")],
    "Pa": [(1.0, "Pa"), (1e3, "kPa"), (1e6, "MPa"), (1e9, "GPa")],
    "m/s": [(1e-9, "nm/s"), (1e-6, "µm/s"), (1e-3, "mm/s"), (1.0, "m/s")],
    "N": [(1.0, "N"), (1e3, "kN"), (1e6, "MN")],
    "N/m": [(1.0, "N/m"), (1e3, "kN/m"), (1e6, "MN/m"), (1e9, "GN/m")],
    "J": [(1e-3, "mJ"), (1.0, "J"), (1e3, "kJ"), (1e6, "MJ"), (1e9, "GJ"), (1e12, "TJ")],
    "J/m": [(1e-3, "mJ/m"), (1.0, "J/m"), (1e3, "kJ/m"), (1e6, "MJ/m"), (1e9, "GJ/m"), (1e12, "TJ/m")],
}


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Wrap a drawing function so that it uses the common style, independent of the user's settings."""

    @wraps(draw)
    def inside(*args: object, **options: object) -> Figure:
        with style():
            return draw(*args, **options)

    return inside


@contextmanager
def style() -> Iterator[None]:
    """Apply the common style to matplotlib within the context, independent of the user's settings."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def warm_up() -> None:
    """Load fonts, the formula parser and other parts that slow down the first figure of a process."""
    with style(), BytesIO() as nowhere:
        figure, axes = new_figure(1, 1, 1.0, 1.0)
        axes[0, 0].set(xlabel="$c_s$", yscale="log")
        letter(axes[0])
        save(figure, nowhere, "png")


def save(figure: Figure, path: Path | BytesIO, kind: str, dpi: float = STYLE["savefig.dpi"]) -> None:
    """Save a figure in the common style, with fixed axes.

    The layout is computed first and then the figure drawn once: matplotlib would draw it twice. If axes of other sizes
    have other tick labels, whose widths differ, the layout is computed again.
    """
    with style():
        engine = figure.get_layout_engine()
        if engine is not None:
            for ax in figure.axes:  # ticks point inwards: no side of a frame reaches beyond it
                for spine in ax.spines.values():
                    spine.set_in_layout(False)
            figure.set_dpi(dpi)
            before = _tick_labels(figure)
            engine.execute(figure)
            if _tick_labels(figure) != before:
                engine.execute(figure)
            figure.set_layout_engine(None)
        # The usual compression takes three times as long and saves a tenth.
        fast: Any = {"pil_kwargs": {"compress_level": 1}} if kind == "png" else {}
        figure.savefig(path, format=kind, dpi=dpi, **fast)


def _tick_labels(figure: Figure) -> list[str]:
    """Return the labels of the vertical axes."""
    return [label.get_text() for ax in figure.axes for label in ax.get_yticklabels()]


def scale(values: Array | float, unit: str) -> tuple[float, str]:
    """Return size and name of a readable unit for the largest value: 0.06 m gives (1e-3, "mm")."""
    numbers = np.abs(np.asarray(values, dtype=float))
    largest = float(numbers[np.isfinite(numbers)].max(initial=0.0))
    choices = _PREFIXES[unit]
    if largest == 0:
        return next(((size, name) for size, name in choices if size == 1.0), choices[0])
    # Slip rates read best in m/s, and times in seconds until 1e8 s.
    least = {"m/s": 0.05, "yr": 1e8 / YEAR}
    fitting = [(size, name) for size, name in choices if largest >= least.get(unit, least.get(name, 0.9)) * size]
    return fitting[-1] if fitting else choices[0]


def known_unit(unit: str) -> bool:
    """Return whether `scale` has prefixes for a unit."""
    return unit in _PREFIXES


def new_figure(rows: int, columns: int, height: float, width: float = WIDTH, **options: Any) -> tuple[Figure, Array]:
    """Return a figure and its array of axes, shape (rows, columns)."""
    figure = blank_figure(width, height)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def blank_figure(width: float, height: float) -> Figure:
    """Return a figure without axes [inches]."""
    return NotebookFigure(figsize=(width, height), layout="constrained")


def set_box(axes: Axes3D, low: Array, high: Array, unit: str, zoom: float = 1.0) -> None:
    """Set ends, labels, equal lengths and ticks of axes in perspective, from the least and largest coordinates."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", zlabel=f"z ({unit})")
    axes.set_box_aspect(high - low, zoom=zoom)
    for axis, part in zip((axes.xaxis, axes.yaxis, axes.zaxis), (high - low) / np.max(high - low), strict=True):
        axis.set_major_locator(MaxNLocator(max(1, round(TICKS * part))))


class NotebookFigure(Figure):
    """A figure that is displayed at the end of a notebook cell, without pyplot; its axes show it, too."""

    def add_subplot(self, *args: Any, **options: Any) -> Any:
        """Add axes that a notebook displays; see `Figure.add_subplot`."""
        if options.get("projection") is None and not (args and isinstance(args[0], Axes)):
            options.pop("projection", None)
            options.setdefault("axes_class", NotebookAxes)
        return super().add_subplot(*args, **options)

    def savefig(self, fname: Any, **options: Any) -> None:
        """Save in the common style, which decides at this time what "C0" and fonts of PDF are; see `Figure.savefig`."""
        options.setdefault("dpi", matplotlib.rcParams["savefig.dpi"])  # of the user
        with style():
            super().savefig(fname, **options)

    def _repr_png_(self) -> bytes:
        with BytesIO() as buffer:
            self.savefig(buffer, format="png", dpi=self.dpi)
            return buffer.getvalue()


class NotebookAxes(Axes):
    """Axes at the end of a notebook cell show their figure."""

    def _repr_png_(self) -> bytes | None:
        return self.figure._repr_png_() if isinstance(self.figure, NotebookFigure) else None


def letter(axes: Iterable[Axes]) -> None:
    """Add panel letters (a), (b), ... above the upper left corner."""
    for index, ax in enumerate(axes):
        ax.set_title(f"({chr(ord('a') + index)})", loc="left", fontweight="bold")


def limit(ax: Axes, values: Array, size: float = 1.0) -> bool:
    """Set the y limits of an axis by quantiles if extremes lie far out; return whether values lie beyond.

    The figure should state that in a remark.

    Returns whether values lie beyond the limits, which the figure should say.
    """
    low, high = np.nanquantile(values, [0.01, 0.99])
    room = high - low
    if not np.nanmax(values) - np.nanmin(values) > OUTLYING * room > 0:
        return False
    ax.set_ylim(max(np.nanmin(values), low - room / 2) / size, min(np.nanmax(values), high + room / 2) / size)
    return True


def note(ax: Axes, text: str) -> None:
    """Write a remark into the middle of an empty panel."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color=MUTED, backgroundcolor="white")


def remark(figure: Figure, *texts: str) -> None:
    """Write remarks that are needed to read the figure, in small type below it."""
    if any(texts):
        width = int(figure.get_figwidth() / REMARK_LETTER)
        figure.supxlabel("\n".join(fill(text, width) for text in texts if text), fontsize=REMARK_SIZE, color=MUTED)


def edges(centres: Array) -> Array:
    """Return cell edges half-way between the centres; the outer cells end at the outer centres."""
    return np.concatenate([centres[:1], (centres[1:] + centres[:-1]) / 2, centres[-1:]])
