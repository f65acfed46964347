"""Opening of an interface."""

from __future__ import annotations

import numpy as np

from ruptfx.plugin import Files, Sheet, Window, at_positions, figure


def suits(record: Files) -> bool:
    """Return whether the run has openings."""
    return "opening" in record.interface


@figure
def opening(sheet: Sheet, record: Files, *, x: Window | None = None) -> None:
    """Draw the largest opening of every point."""
    data = at_positions(record.interface, x, sheet.name)
    largest, position = data["opening"].values.max(axis=0), data["position"].values
    (size, unit), (length, of_x) = sheet.scale("opening", largest, "m"), sheet.scale("x", np.ptp(position), "m")
    ax = sheet.panels(1, 1, 2.6)[0, 0]
    ax.plot(position / length, largest / size)
    ax.margins(x=0)
    ax.set(xlabel=f"Position ({of_x})", ylabel=f"Largest opening ({unit})")
