"""Figure of the particle velocity in the bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import WAVE_MAP, Array
from ruptfx.results.plots._panels import bulk_field, panels
from ruptfx.results.plots._record import has_pictures, has_slip_rates, is_quasi_static, is_uneven
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Files

SPEED = "speed"
SLIDES = "#35d6c8"


def suits(record: Files) -> bool:
    """Return whether pictures of the velocity exist and show waves: not quasi-static, and evenly saved times."""
    slow = is_quasi_static(record) or (has_slip_rates(record) and is_uneven(record))
    return has_pictures(record, "velocity") and not slow


@figure
def wavefield(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str = SPEED,
) -> None:
    """Draw a field of the bodies with the interface; in the particle speed, shear Mach fronts are straight lines.

    Sliding points of the interface are marked.

    Parameters
    ----------
    at
        Times [s]; the nearest snapshots are drawn. Default: four while the rupture runs.
    field : str
        "speed", or a saved component such as "velocity_x", "displacement_y", "stress_xy". Default: the particle speed.
    """
    if field == SPEED:
        if "velocity" not in record.bulk:
            sheet.empty("no velocities were saved")
            return

        def speed(row: int, raster: Raster) -> Array:
            return raster(np.linalg.norm(record.bulk["velocity"].isel(time=row).values, axis=-1))

        panels(sheet, record, at, x, speed, "Particle speed", "white", SLIDES, "m/s", cmap=WAVE_MAP, vmin=0)
        return
    values, unit = bulk_field(record, field, sheet.name, [SPEED])

    def component(row: int, raster: Raster) -> Array:
        return raster(values(row))

    label = field.replace("_", " ").capitalize()
    panels(sheet, record, at, x, component, label, "#1a1a1a", None, unit, cmap="RdBu_r", both=True)
