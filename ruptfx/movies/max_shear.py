"""Largest shear stress in the bodies, total."""

from __future__ import annotations

from dataclasses import replace

from ruptfx.analysis.raster import Raster
from ruptfx.figure_style import Array
from ruptfx.movies import Film, assumed, bodies
from ruptfx.record import Record


def max_shear(record: Record) -> Film:
    def shear(row: int, raster: Raster) -> Array:
        return raster(0.5e-6 * record.bulk["fringe"].isel(time=row).values)

    film = bodies(record, shear, "Largest shear stress (MPa)", "white", cmap="viridis", vmin=0)
    return replace(film, remark=assumed(record))
