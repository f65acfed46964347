"""Pictures of the bodies at several times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis import slides_far
from ruptfx.analysis.raster import Raster
from ruptfx.figure_style import WIDTH, Array, empty_figure, letter, new_figure, scale
from ruptfx.plots._record import default_times, nearest, sliding
from ruptfx.record import Files

_last: list[tuple[Array, Array, Raster]] = []


def panels(
    record: Files,
    time: float | Sequence[float] | None,
    picture: Callable[[int, Raster], Array],
    label: str,
    line: str,
    marks: str | None = None,
    unit: str = "",
    **look: object,
) -> Figure:
    """Draw one panel per time, in two columns if there are several, with one common colour scale.

    Interfaces have the colour `line`, and their sliding points, if it is given, the colour `marks`. Values
    with a `unit` get a prefix.
    """
    bulk = record.bulk
    saved = bulk["time"].values
    rows = default_times(record, saved, 4) if time is None else nearest(saved, np.atleast_1d(np.asarray(time)))
    if not len(rows):
        return without("no snapshot was saved")
    rasters = _displaced(record, rows)
    moved = "" if rasters is None else ", displaced"
    rasters = rasters or [raster_of(record)] * len(rows)
    images = [picture(int(row), raster) for row, raster in zip(rows, rasters, strict=True)]
    if unit:
        size, printed = scale(max(float(np.nanmax(np.abs(image))) for image in images), unit)
        images, label = [image / size for image in images], f"{label} ({printed})"
    raster = rasters[0]
    extend = "neither"
    if "vmax" not in look:
        # A few bright pixels at the tip must not darken the waves.
        look["vmax"] = max(np.nanquantile(image, 0.998) for image in images) or 1.0
        extend = "max"
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(bulk["points"].values, axis=0), "m"), scale(saved, "s")
    columns = min(len(rows), 2)
    lines = -(-len(rows) // columns)
    width = (WIDTH - 0.6) / columns
    height = lines * (0.3 + width * raster.shape[0] / raster.shape[1]) + 0.9
    height += 0.35 * (len(rows) % columns)  # an incomplete last row needs axis labels above it
    figure, axes = new_figure(lines, columns, height, sharex=True, sharey=True)
    extent = [value / x_size for value in raster.extent]
    for ax, row, image in zip(axes.ravel(), rows, images, strict=False):
        ax.set_facecolor("#dbe4ec")  # pixels without a value differ from every colour of the map
        shown = ax.imshow(image, origin="lower", extent=extent, interpolation="antialiased", **look)
        for data in record.interfaces.values():
            x, y = data["x"].values, data["y"].values
            if moved and slides_far(data):
                (now,) = nearest(data["time"].values, saved[row])
                x, y = (data[name].isel(time=int(now)).values for name in ("deformed_x", "deformed_y"))
            x, y = x / x_size, y / x_size
            ax.plot(x, y, color=line, lw=0.6)
            if marks is not None:
                slides = sliding(data, saved[row])
                ax.plot(x[slides], y[slides], ".", color=marks, ms=2.2, mew=0, gid="sliding")
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
    for ax in axes.ravel()[:len(rows)][-columns:]:
        ax.set_xlabel(f"x{moved} ({x_unit})")
        ax.tick_params(labelbottom=True)
    for ax in axes[:, 0]:
        ax.set_ylabel(f"y{moved} ({x_unit})")
    for ax in axes.ravel()[len(rows):]:
        ax.set_visible(False)
    figure.colorbar(
        shown, ax=axes.ravel().tolist(), label=label, location="bottom", shrink=0.4, aspect=30, extend=extend
    )
    letter(axes.ravel()[: len(rows)])
    return figure


def raster_of(record: Files) -> Raster:
    """Return the pixel raster of a run, cached for all figures of the same mesh."""
    mesh = record.bulk["points"].values, record.bulk["cells"].values
    if not _last or not all(map(np.array_equal, mesh, _last[0][:2])):
        _last[:] = [(*mesh, Raster(*mesh))]
    return _last[0][2]


def _displaced(record: Files, rows: Array) -> list[Raster] | None:
    """Return the raster of every row on the same window if bodies move or slide far; else None."""
    far = record.case.get("large_rotations") or any(map(slides_far, record.interfaces.values()))
    if not far or "displacement" not in record.bulk:
        return None
    start, cells = record.bulk["points"].values, record.bulk["cells"].values
    places = [start + record.bulk["displacement"].isel(time=int(row)).values for row in rows]
    corners = np.min(places, axis=(0, 1)), np.max(places, axis=(0, 1))
    return [Raster(points, cells, corners=corners) for points in places]


def without(text: str) -> Figure:
    """Return an empty figure with a message."""
    return empty_figure(text, "x (m)", "y (m)")
