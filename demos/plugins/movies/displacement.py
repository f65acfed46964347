"""Displacement of the bodies."""

from __future__ import annotations

import numpy as np

from ruptfx.plugin import WAVE_MAP, Film, Raster, Record, bodies


def displacement(record: Record) -> Film:
    """Return the film of the length of the displacement."""

    def length(row: int, raster: Raster) -> np.ndarray:
        return raster(np.linalg.norm(record.bulk["displacement"].isel(time=row).values, axis=-1))

    return bodies(record, length, "Displacement (m)", "white", cmap=WAVE_MAP, vmin=0)
