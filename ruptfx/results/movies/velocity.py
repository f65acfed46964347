"""Particle speed in the bodies."""

from __future__ import annotations

import numpy as np

from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import WAVE_MAP, Array
from ruptfx.results.movies import Film, bodies
from ruptfx.results.record import Record


def velocity(record: Record) -> Film:
    """Return the film of the particle speed."""

    def speed(row: int, raster: Raster) -> Array:
        return raster(np.linalg.norm(record.bulk["velocity"].isel(time=row).values, axis=-1))

    return bodies(record, speed, "Particle speed (m/s)", "white", cmap=WAVE_MAP, vmin=0)
