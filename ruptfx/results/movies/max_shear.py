"""Largest in-plane shear stress of the bodies, including the initial stress, with its contours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.ticker import MaxNLocator

from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import Array
from ruptfx.results.movies import Film, assumed, bodies
from ruptfx.results.record import Record

CONTOURS, COARSER = 8, 3  # largest number of contours; pixel stride of the field from which they are drawn
NUDGE = 0.05  # of a step: avoids a contour at a round initial stress, where it would follow rounding errors


def max_shear(record: Record) -> Film:
    """Return the film of the largest in-plane shear stress."""

    def shear(row: int, raster: Raster) -> Array:
        return raster(0.5e-6 * record.bulk["fringe"].isel(time=row).values)

    film = bodies(record, shear, "", "white", cmap="viridis", vmin=0)
    levels = np.array(MaxNLocator(CONTOURS, steps=[1, 2, 5, 10]).tick_values(0, film.look["vmax"]))
    levels = levels + NUDGE * (levels[1] - levels[0])
    label = f"Largest shear stress in the plane (MPa),\na contour every {levels[1] - levels[0]:g} MPa"
    drawn: list[ContourSet] = []

    def move(axes: Axes, row: int) -> None:
        film.move(axes, row)
        while drawn:
            drawn.pop().remove()
        shown = np.ma.filled(np.ma.asarray(axes.images[0].get_array()), np.nan)  # the picture of this time
        image = shown[COARSER // 2 :: COARSER, COARSER // 2 :: COARSER]
        inside = levels[(levels > np.nanmin(image)) & (levels < np.nanmax(image))]
        if len(inside):
            left, right, bottom, top = film.extent
            rows, columns = ((np.arange(n) + 0.5) / n for n in image.shape)
            x, y = left + columns * (right - left), bottom + rows * (top - bottom)
            drawn.append(axes.contour(x, y, image, inside, colors="white", linewidths=0.5))

    return replace(film, label=label, move=move, remark=assumed(record))
