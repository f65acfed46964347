"""Contact states in figures: their names and colours."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ruptfx.results.analysis import slides_far
from ruptfx.results.record import Files

COLOURS = {"open": "#d9d9d9", "sticking": "#2a6099", "sliding": "#e07b39", "uncovered": "#fbf3d5"}
"""By meaning, in the order of the values 0, 1, 2 ... of the field `contact`."""


def has_states(record: Files) -> bool:
    """Return whether the run has an interface with finite sliding and saved times."""
    return bool(record.interfaces) and slides_far(record.interface) and record.interface.sizes["time"] > 0


def explain(ax: Axes, **options: Any) -> None:
    """Add a legend of the colours."""
    ax.legend(handles=[Patch(fc=colour, ec="#555555", lw=0.3, label=name) for name, colour in COLOURS.items()],
              ncols=len(COLOURS), **options)  # fmt: skip
