"""Contact states in figures: their names and colours."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ruptfx.results.analysis import slides_far
from ruptfx.results.analysis.surface import is_surface
from ruptfx.results.record import Files

COLOURS = {"open": "#d9d9d9", "sticking": "#2a6099", "sliding": "#e07b39", "uncovered": "#fbf3d5"}
"""By meaning, in the order of the values 0, 1, 2 ... of the field `contact`."""


def has_states(record: Files) -> bool:
    """Return whether the run has a line with finite sliding and saved times."""
    data = record.interface if record.interfaces else None
    return data is not None and slides_far(data) and not is_surface(data) and data.sizes["time"] > 0


def explain(ax: Axes, per_line: int = len(COLOURS), **options: Any) -> None:
    """Add a legend of the colours, with several in a line."""
    ax.legend(handles=[Patch(fc=colour, ec="#555555", lw=0.3, label=name) for name, colour in COLOURS.items()],
              ncols=per_line, **options)  # fmt: skip
