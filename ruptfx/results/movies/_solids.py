"""Solids in a movie: their outer surfaces in perspective, one body left out so that the interface is seen.

matplotlib draws them without a screen or OpenGL, as on the node of a cluster.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ruptfx.results.figure_style import Array, blank_figure, scale, set_box
from ruptfx.results.movies import Film, brightest
from ruptfx.results.record import Record

FACETS = {
    4: [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]],
    8: [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
}
"""Corners of the facets of a cell, around each of them, by the number of its corners."""
WIDTH, HEIGHT, RESOLUTION = 6.0, 4.2, 130  # of the picture [inches], and pixels per inch
TURN, ELEVATION, FLAT = 35.0, 25.0, 0.8  # view [degrees] from the normal of the interface; its z above which it is flat


def solids(record: Record, field: Callable[[int], Array], label: str, cmap: str) -> Film:
    """Return the film of a field on the outer surfaces of the bodies.

    Parameters
    ----------
    field : callable, snapshot -> ndarray, shape (points,)
        Values at the points of `record.bulk`, not negative.
    label : str
        Of the colours, with a unit.
    """
    bulk = record.bulk
    points, cells = bulk["points"].values, bulk["cells"].values
    hidden, normal = _in_front(record)
    view = _view(normal)
    shown = cells[~np.isin(bulk["body_of_cell"].values, hidden)]
    facets = facing(points, shown, _towards(*view))
    times = bulk["time"].values
    look = brightest(lambda row: field(row)[facets], len(times), {"cmap": cmap})
    norm = look["norm"] = Normalize(0.0, look.pop("vmax"))
    colours = colormaps[cmap]
    canvas, surface = _drawing(points, facets, view)

    def image(row: int) -> Array:
        values = field(row)[facets].mean(axis=1)
        surface.set_facecolor(cast(Any, colours(norm(values))))
        canvas.draw()
        pixels: Array = np.asarray(canvas.buffer_rgba())[::-1, :, :3].copy()
        return pixels

    left_out = [str(bulk.attrs["bodies"][number]) for number in hidden]
    remark = f"Without the body {left_out[0]}, so that the interface is seen." if left_out else ""
    extent = (0.0, WIDTH * RESOLUTION, 0.0, HEIGHT * RESOLUTION)
    return Film(times, image, extent, "", "", label, look, draw=lambda axes: axes.set_axis_off(), remark=remark)


def _in_front(record: Record) -> tuple[list[int], Array]:
    """Return numbers of bodies to leave out, and the direction from minus to plus side of `record.interface`."""
    bulk = record.bulk
    names = [str(name) for name in bulk.attrs["bodies"]]
    sides = [names.index(name) for name in map(str, record.interface.attrs.get("bodies", ())) if name in names]
    if len(set(sides)) < 2:
        return [], np.array([0.0, 1.0, 0.0])
    plus, minus = (bulk["points"].values[bulk["body"].values == number].mean(axis=0) for number in sides)
    normal: Array = (plus - minus) / np.linalg.norm(plus - minus)
    return sides[:1], normal


def _view(normal: Array) -> tuple[float, float]:
    """Return elevation and azimuth of the viewer [degrees], on the side to which the normal of an interface points."""
    if abs(normal[2]) > FLAT:
        return float(np.copysign(ELEVATION, normal[2])), -60.0
    return ELEVATION, float(np.degrees(np.arctan2(normal[1], normal[0]))) - TURN


def _towards(elevation: float, azimuth: float) -> Array:
    """Return the direction to the viewer."""
    up, around = np.radians([elevation, azimuth])
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


def facing(points: Array, cells: Array, towards: Array) -> Array:
    """Return facets that belong to one cell only and face a direction, shape (facets, corners).

    Parameters
    ----------
    points : ndarray, shape (points, 3)
    cells : ndarray, shape (cells, 4 or 8)
    towards : ndarray, shape (3,)
    """
    local = FACETS[cells.shape[1]]
    facets = cells[:, local].reshape(-1, len(local[0]))
    # Both cells of an inner facet have the same sum of random numbers of its corners.
    random = np.random.default_rng(0).integers(1 << 62, size=len(points), dtype=np.uint64)
    _, first, count = np.unique(random[facets].sum(axis=1), return_index=True, return_counts=True)
    outer = first[count == 1]
    corners = points[facets[outer]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside = points[cells[outer // len(local)]].mean(axis=1) - corners.mean(axis=1)
    outwards = -np.sign(np.sum(normals * inside, axis=1))
    visible: Array = facets[outer[outwards * (normals @ towards) > 0]]
    return visible


def _drawing(points: Array, facets: Array, view: tuple[float, float]) -> tuple[FigureCanvasAgg, Poly3DCollection]:
    """Return the canvas of a picture of facets, and the collection whose colours are set."""
    corners = points[facets]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size, unit = scale(high - low, "m")
    figure = blank_figure(WIDTH, HEIGHT)
    figure.set_layout_engine("none")
    figure.set_dpi(RESOLUTION)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    assert isinstance(axes, Axes3D)
    axes.set_proj_type("ortho")
    surface = Poly3DCollection(corners / size, linewidth=0, antialiased=False)
    axes.add_collection3d(surface)
    set_box(axes, low / size, high / size, unit, zoom=1.1)
    axes.view_init(*view)
    return FigureCanvasAgg(figure), surface
