"""Particle speed in the bodies; of solids, on their outer surfaces."""

from __future__ import annotations

import numpy as np

from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import WAVE_MAP, Array
from ruptfx.results.movies import Film, bodies, several_snapshots
from ruptfx.results.movies._solids import solids
from ruptfx.results.record import Record


def velocity(record: Record) -> Film:
    """Return the film of the particle speed."""

    def speed(row: int) -> Array:
        magnitude: Array = np.linalg.norm(record.bulk["velocity"].isel(time=row).values, axis=-1)
        return magnitude

    def picture(row: int, raster: Raster) -> Array:
        return raster(speed(row))

    label = "Particle speed (m/s)"
    if record.case.get("plane") == "solid":
        several_snapshots(record)
        return solids(record, speed, label, WAVE_MAP)
    return bodies(record, picture, label, "white", cmap=WAVE_MAP, vmin=0)
