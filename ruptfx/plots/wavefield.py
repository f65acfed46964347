"""Figure of the particle velocity in the bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.raster import Raster
from ruptfx.figure_style import WAVE_MAP, Array, styled
from ruptfx.plots._panels import panels, without
from ruptfx.plots._record import has_pictures, has_slip_rates, is_quasi_static, is_uneven
from ruptfx.record import Files

SLIDES = "#35d6c8"


def suits(record: Files) -> bool:
    """Return whether pictures of the velocity exist and show waves: not quasi-static, and evenly saved times."""
    slow = is_quasi_static(record) or (has_slip_rates(record) and is_uneven(record))
    return has_pictures(record, "velocity") and not slow


@styled
def wavefield(record: Files, time: float | Sequence[float] | None = None) -> Figure:
    """Draw the particle speed in the two bodies with the interface; shear Mach fronts appear as straight lines.

    Sliding points of the interface are marked.

    Parameters
    ----------
    record : Record or Files
    time : float or sequence of float, optional
        Times [s]; the nearest snapshots are drawn. Default: four while the rupture runs.
    """
    if "velocity" not in record.bulk:
        return without("no velocities were saved")

    def speed(row: int, raster: Raster) -> Array:
        return raster(np.linalg.norm(record.bulk["velocity"].isel(time=row).values, axis=-1))

    return panels(record, time, speed, "Particle speed", "white", SLIDES, "m/s", cmap=WAVE_MAP, vmin=0)
