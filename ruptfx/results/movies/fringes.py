"""Isochromatic fringes, dark field."""

from __future__ import annotations

from dataclasses import replace

from ruptfx import RuptfxError
from ruptfx.results.analysis.photoelasticity import intensity
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import Array
from ruptfx.results.movies import Film, assumed, bodies, in_two_dimensions
from ruptfx.results.plots.fringes import Plates
from ruptfx.results.record import Record


def fringes(record: Record) -> Film:
    """Return the film of isochromatic fringes."""
    in_two_dimensions(record)
    plates = Plates(record)
    if plates.missing:
        raise RuptfxError(f"{record.path}: {' '.join(plates.missing.split())}")

    def light(row: int, raster: Raster) -> Array:
        return intensity(raster(plates.order(row)))

    label = f"Dark field; {plates.per_fringe()}"
    film = bodies(record, light, label, "#d9480f", cmap="gray", vmin=0, vmax=1)
    return replace(film, remark=assumed(record))
