"""The common look of all figures: sizes, colours, units on axes, panel letters, wave speeds.

Figures are made without pyplot, so they need no display and leave no global state behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ruptfx.record import Record

Array = np.ndarray

WIDTH = 7.0  # inch, two columns of a journal
STYLE: Any = {
    "font.size": 8, "axes.labelsize": 8, "axes.titlesize": 8, "legend.fontsize": 7, "xtick.labelsize": 7,
    "ytick.labelsize": 7, "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "xtick.direction": "in", "ytick.direction": "in", "xtick.top": True, "ytick.right": True,
    "lines.linewidth": 1.0, "legend.frameon": False, "savefig.dpi": 200, "figure.dpi": 100, "pdf.fonttype": 42,
    "axes.formatter.useoffset": False, "agg.path.chunksize": 20000,
}
GUIDE = "#1769aa"  # wave speeds
MUTED = "#888888"
# Perceptually uniform, cut where lines and guides would not show.
RATE_MAP = ListedColormap(matplotlib.colormaps["magma_r"](np.linspace(0.03, 0.9, 256)))
TIME_MAP = ListedColormap(matplotlib.colormaps["viridis_r"](np.linspace(0.12, 1, 256)))
WAVE_MAP = "inferno"

_PREFIXES = {
    "m": [(1e-6, "µm"), (1e-3, "mm"), (1.0, "m"), (1e3, "km")],
    "s": [(1e-6, "µs"), (1e-3, "ms"), (1.0, "s")],
    "Pa": [(1e3, "kPa"), (1e6, "MPa"), (1e9, "GPa")],
    "m/s": [(1e-6, "µm/s"), (1e-3, "mm/s"), (1.0, "m/s")],
    "J/m": [(1e-3, "mJ/m"), (1.0, "J/m"), (1e3, "kJ/m"), (1e6, "MJ/m"), (1e9, "GJ/m"), (1e12, "TJ/m")],
}


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw with the common style, whatever the user's own settings are."""

    @wraps(draw)
    def inside(*args: Any, **options: Any) -> Figure:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(STYLE)
            return draw(*args, **options)

    return inside


def scale(values: Array | float, unit: str) -> tuple[float, str]:
    """Size and name of the unit in which the largest value reads well: 0.06 m gives (1e-3, "mm")."""
    numbers = np.abs(np.asarray(values, dtype=float))
    largest = float(numbers[np.isfinite(numbers)].max(initial=0.0))
    choices = _PREFIXES[unit]
    if largest == 0:
        return next(((size, name) for size, name in choices if size == 1.0), choices[0])
    least = 0.05 if unit == "m/s" else 0.9  # slip rates read best in m/s
    fitting = [(size, name) for size, name in choices if largest >= least * size]
    return fitting[-1] if fitting else choices[0]


def new_figure(rows: int, columns: int, height: float, width: float = WIDTH, **options: Any) -> tuple[Figure, Array]:
    """Figure and its array of axes, shape (rows, columns)."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def letter(axes: Iterable[Axes]) -> None:
    """Panel letters (a), (b), ... above the upper left corner."""
    for index, ax in enumerate(axes):
        ax.set_title(f"({chr(ord('a') + index)})", loc="left", fontweight="bold")


def note(ax: Axes, text: str) -> None:
    """A remark in the middle of an empty panel."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color=MUTED, backgroundcolor="white")


def wave_speeds(record: Record) -> dict[str, float]:
    """Speeds of the guide lines [m/s] by label; antiplane motion knows only c_s."""
    attrs = record.interface.attrs
    speeds = {
        "$c_R$": attrs.get("c_R"), "$c_s$": attrs.get("c_s"),
        r"$\sqrt{2}\,c_s$": np.sqrt(2) * attrs.get("c_s", np.nan), "$c_l$": attrs.get("c_p"),
    }
    if attrs.get("plane") == "antiplane":
        speeds = {"$c_s$": attrs.get("c_s")}
    return {name: float(value) for name, value in speeds.items() if value is not None and np.isfinite(value)}


def end_time(record: Record) -> float:
    """Last saved time [s], or the planned end where nothing but the start was saved."""
    last = record.interface["time"].values[-1:]
    return float(last[0]) if last.sum() > 0 else float(record.case.get("duration", 1.0))


def direction(record: Record) -> float:
    """Sign of the slip: figures count slip and shear traction positive in its direction."""
    last = record.interface["slip"].isel(time=slice(-1, None)).values
    return -1.0 if last.sum() < 0 else 1.0


def default_times(record: Record, saved: Array, count: int) -> Array:
    """Indices of up to `count` saved times while the rupture runs; over the whole run where nothing slid."""
    tracked = [data["rupture_time"].values for data in record.interfaces.values() if "rupture_time" in data]
    arrival = np.concatenate([*tracked, np.array([])])
    arrival = arrival[np.isfinite(arrival)]
    first, last = np.quantile(arrival, [0.15, 1.0]) if len(arrival) else (0.0, np.inf)
    running = np.flatnonzero((saved >= first) & (saved <= last))
    running = running if len(running) else np.arange(len(saved))[-1:]
    # Even steps back from the last, which shows most.
    step = max(1, (len(running) - 1) // max(count - 1, 1))
    return running[::-step][:count][::-1]


def nearest(saved: Array, wanted: Array) -> Array:
    """Index of the saved time nearest to each wanted time."""
    return np.abs(np.asarray(saved)[None, :] - np.atleast_1d(wanted)[:, None]).argmin(axis=1)


def edges(centres: Array) -> Array:
    """Cell edges half-way between the centres; the outer cells end at the outer centres."""
    return np.concatenate([centres[:1], (centres[1:] + centres[:-1]) / 2, centres[-1:]])
