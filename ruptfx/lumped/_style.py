"""One look for the figures of the lumped models: journal column widths, small sans type, no boxes."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib
from matplotlib.figure import Figure

ONE_COLUMN, TWO_COLUMNS = 3.5, 7.1  # inches
STICK_SLIP, STEADY, UNDECIDED, ACCENT = "#b5382a", "#2a6099", "#8a8a8a", "#e0a030"

_STYLE: Any = {
    "font.size": 8, "axes.labelsize": 8, "axes.titlesize": 8, "xtick.labelsize": 7, "ytick.labelsize": 7,
    "legend.fontsize": 7, "legend.frameon": False, "axes.spines.top": False, "axes.spines.right": False,
    "axes.linewidth": 0.7, "lines.linewidth": 1.0, "lines.markersize": 4, "xtick.direction": "out",
    "image.interpolation": "nearest", "axes.titlelocation": "left", "mathtext.default": "it",
}


P = ParamSpec("P")
R = TypeVar("R")


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Draw in this style whatever the user's own settings are."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context(_STYLE):
            return draw(*args, **kwargs)

    return drawn


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inches] that belongs to no window system."""
    return Figure(figsize=(width, height), layout="constrained")
