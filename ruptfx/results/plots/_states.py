"""Contact states in figures: their names and colours."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ruptfx.results.analysis import slides_far
from ruptfx.results.analysis.surface import is_surface
from ruptfx.results.figure_style import Array
from ruptfx.results.record import Files

COLOURS = {"open": "#d9d9d9", "sticking": "#2a6099", "sliding": "#e07b39", "uncovered": "#fbf3d5"}
"""By meaning, in the order of the values 0, 1, 2 ... of the field `contact`."""


def has_states(record: Files) -> bool:
    """Return whether the run has a line with finite sliding and saved times."""
    data = record.interface if record.interfaces else None
    return data is not None and slides_far(data) and not is_surface(data) and data.sizes["time"] > 0


def explain(ax: Axes, drawn: Collection[str], per_line: int = len(COLOURS), **options: Any) -> None:
    """Add a legend of the colours of the states that are drawn, with several in a line."""
    shown = {name: colour for name, colour in COLOURS.items() if name in drawn}
    ax.legend(handles=[Patch(fc=colour, ec="#555555", lw=0.3, label=name) for name, colour in shown.items()],
              ncols=per_line, **options)  # fmt: skip


def names_of(states: Array) -> list[str]:
    """Return the names of the values of the field `contact` that occur; those that are not numbers have none."""
    return [name for value, name in enumerate(COLOURS) if np.any(states == value)]
