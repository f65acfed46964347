"""The common look of all figures: sizes, colours, units on axes, panel letters, wave speeds.

Figures are made without pyplot, so they need no display and leave no global state behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, NamedTuple

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
STYLES = {"--": "dashed", ":": "dotted", "-.": "dash-dotted"}  # of the bodies they belong to
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


class Guide(NamedTuple):
    """A wave speed to compare with: what to call it, the speed [m/s], the line style of its body."""

    symbol: str
    speed: float
    style: str = "--"


def guides(record: Record, *wanted: str) -> list[Guide]:
    """Wave speeds, of those wanted (``c_R c_s Eshelby c_p``; default all) the ones that exist.

    Antiplane motion knows only c_s. Where bodies differ these are c_s and c_p of each, in a line style of its own:
    neither the Rayleigh nor the Eshelby speed of one body is a speed of the interface.
    """
    attrs = record.interface.attrs
    plane = attrs.get("plane")
    symbols = {
        "c_R": "$c_R$", "c_s": "$c_s$", "Eshelby": r"$\sqrt{2}\,c_s$", "c_p": "$c_l$" if plane == "stress" else "$c_p$",
    }  # fmt: skip
    bodies = list(_bodies_by_speeds(record))
    if len(bodies) > 1:
        found = [
            Guide(symbols[name], speed, style)
            for speeds, style in zip(bodies, STYLES, strict=False)
            for name, speed in zip(("c_p", "c_s"), speeds, strict=True)
            if name in (wanted or symbols) and (name == "c_s" or plane != "antiplane")
        ]
        found.sort(key=lambda guide: guide.speed)
    else:
        speed = {name: attrs.get(name, np.nan) for name in ("c_R", "c_s", "c_p")}
        speed["Eshelby"] = np.sqrt(2) * speed["c_s"]
        known = ["c_s"] if plane == "antiplane" else list(symbols)
        found = [Guide(symbols[name], float(speed[name])) for name in known if name in (wanted or symbols)]
    return [guide for guide in found if np.isfinite(guide.speed)]


def _bodies_by_speeds(record: Record) -> dict[tuple[float, float], list[str]]:
    """Names of the bodies that share c_p and c_s [m/s]."""
    attrs = record.interface.attrs
    columns = [np.atleast_1d(attrs.get(name, [])) for name in ("bodies", "c_p_of_bodies", "c_s_of_bodies")]
    groups: dict[tuple[float, float], list[str]] = {}
    for name, c_p, c_s in zip(*columns, strict=True):
        groups.setdefault((float(c_p), float(c_s)), []).append(str(name))
    return groups


def along(record: Record, size: float, unit: str) -> str:
    """Label of an axis along the first interface: x, or from where positions are measured."""
    attrs = record.interface.attrs
    if attrs.get("position_measure") == "x":
        return f"x ({unit})"
    if attrs.get("position_measure") == "arc length":
        start = ", ".join(f"{value / size:.4g}" for value in attrs["origin"])
        return f"Arc length from ({start}) ({unit})"
    return f"Position along the interface ({unit})"


def end_time(record: Record) -> float:
    """Last saved time [s], or the planned end where nothing but the start was saved."""
    last = record.interface["time"].values[-1:]
    return float(last[0]) if last.sum() > 0 else float(record.case.get("duration", 1.0))


def remark(figure: Figure, *texts: str) -> None:
    """What has to be known to read the figure right, in small type below it."""
    if any(texts):
        figure.supxlabel("\n".join(text for text in texts if text), fontsize=6.5, color=MUTED)


def whose_speeds(record: Record) -> str:
    """Which line style is which body's, where their wave speeds differ."""
    groups = [", ".join(names) for names in _bodies_by_speeds(record).values()]
    if len(groups) < 2:
        return ""
    return "Wave speeds: " + "; ".join(f"{STYLES[s]} {g}" for s, g in zip(STYLES, groups, strict=False)) + "."


def turned(record: Record) -> str:
    """Says so where figures turn the sign of slip and shear traction."""
    against = "Slip is against the tangent of the interface: signs of slip, slip rate and shear traction are turned."
    return against if direction(record) < 0 else ""


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
