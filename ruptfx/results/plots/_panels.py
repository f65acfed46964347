"""Pictures of the bodies at several times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.fields import STRESSES, stress_entries
from ruptfx.input.schema import nearest as nearest_name
from ruptfx.results.analysis import slides_far
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import WIDTH, Array
from ruptfx.results.plots._record import chosen, default_times, nearest, sliding
from ruptfx.results.plots._sheet import Sheet, Window, pair
from ruptfx.results.record import Files

HIGHEST = 9.0  # inch: a page
_last: list[tuple[Array, Array, Raster]] = []


def panels(  # noqa: PLR0913
    sheet: Sheet,
    record: Files,
    at: float | Sequence[float] | None,
    x: Window | None,
    picture: Callable[[int, Raster], Array],
    label: str,
    line: str,
    marks: str | None = None,
    unit: str = "",
    both: bool = False,
    **look: object,
) -> None:
    """Draw one panel per time, in two columns if there are several, with one common colour scale.

    Interfaces have the colour `line`, and their sliding points, if it is given, the colour `marks`. Values
    with a `unit` get a prefix. Colours of values with `both` signs are symmetric about zero.
    """
    bulk = record.bulk
    saved = bulk["time"].values
    rows = chosen(saved, at, default_times(record, saved, 1 if sheet.is_given else 4))
    if not len(rows):
        sheet.empty("no snapshot was saved")
        return
    sheet.one_of("choose one time with at = 30e-6")
    rasters = _displaced(record, rows)
    moved = "" if rasters is None else ", displaced"
    rasters = rasters or [raster_of(record)] * len(rows)
    images = [picture(int(row), raster) for row, raster in zip(rows, rasters, strict=True)]
    raster = rasters[0]
    columns, ends = _columns(raster, x, sheet.name)
    images = [image[:, columns] for image in images]
    if unit:
        size, printed = sheet.scale("field", max(float(np.nanmax(np.abs(image))) for image in images), unit)
        images, label = [image / size for image in images], f"{label} ({printed})"
    extend = "neither"
    if both:
        high = max(np.nanquantile(np.abs(image), 0.998) for image in images) or 1.0
        look, extend = {"vmin": -high, "vmax": high, **look}, "both"
    elif "vmax" not in look:
        # A few bright pixels at the tip must not darken the waves.
        look["vmax"] = max(np.nanquantile(image, 0.998) for image in images) or 1.0
        extend = "max"
    x_size, x_unit = sheet.scale("x", np.ptp(bulk["points"].values, axis=0), "m")
    t_size, t_unit = sheet.scale("time", saved, "s")
    beside = min(len(rows), 2)
    lines = -(-len(rows) // beside)
    width = (WIDTH - 0.6) / beside
    height = lines * (0.3 + width * images[0].shape[0] / images[0].shape[1]) + 0.9
    height += 0.35 * (len(rows) % beside)  # an incomplete last row needs axis labels above it
    axes = sheet.panels(lines, beside, min(height, HIGHEST), sharex=True, sharey=True)
    extent = [value / x_size for value in ends]
    for ax, row, image in zip(axes.ravel(), rows, images, strict=False):
        ax.set_facecolor("#dbe4ec")  # pixels without a value differ from every colour of the map
        shown = ax.imshow(image, origin="lower", extent=extent, interpolation="antialiased", **look)
        for data in record.interfaces.values():
            across, up = data["x"].values, data["y"].values
            if moved and slides_far(data):
                (now,) = nearest(data["time"].values, saved[row])
                across, up = (data[name].isel(time=int(now)).values for name in ("deformed_x", "deformed_y"))
            across, up = across / x_size, up / x_size
            ax.plot(across, up, color=line, lw=0.6)
            if marks is not None:
                slides = sliding(data, saved[row])
                ax.plot(across[slides], up[slides], ".", color=marks, ms=2.2, mew=0, gid="sliding")
        ax.set(xlim=extent[:2], ylim=extent[2:])
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
    for ax in axes.ravel()[: len(rows)][-beside:]:
        ax.set_xlabel(f"x{moved} ({x_unit})")
        ax.tick_params(labelbottom=True)
    for ax in axes[:, 0]:
        ax.set_ylabel(f"y{moved} ({x_unit})")
    for ax in axes.ravel()[len(rows) :]:
        ax.set_visible(False)
    sheet.figure.colorbar(
        shown, ax=axes.ravel().tolist(), label=label, location="bottom", shrink=0.4, aspect=30, extend=extend
    )
    sheet.letter(axes.ravel()[: len(rows)])


def _columns(raster: Raster, x: Window | None, title: str) -> tuple[slice, tuple[float, float, float, float]]:
    """Return the columns of pixels in a window of x, and their extent [m].

    Raises
    ------
    RuptfxError
        There is no pixel.
    """
    left, right, bottom, top = raster.extent
    if x is None:
        return slice(None), (left, right, bottom, top)
    low, high = pair(title, "x", x)
    step = (right - left) / raster.shape[1]
    first = 0 if low is None else max(int(np.floor((low - left) / step + 1e-6)), 0)
    last = raster.shape[1] if high is None else min(int(np.ceil((high - left) / step - 1e-6)), raster.shape[1])
    if last <= first:
        raise RuptfxError(f"plots.{title}: x = ({low}, {high}) has no body, these run from {left:g} to {right:g} m")
    return slice(first, last), (left + first * step, left + last * step, bottom, top)


def bulk_field(record: Files, name: str, title: str, others: Sequence[str]) -> tuple[Callable[[int], Array], str]:
    """Return a function of the snapshot that gives a component at all points, and its unit.

    Raises
    ------
    RuptfxError
        No such component was saved.
    """
    bulk = record.bulk
    entries = {len(names): list(names) for names in (*STRESSES.values(), stress_entries("axisymmetric", 2))}
    points, times = len(bulk["points"].values), len(bulk["time"].values)
    known: dict[str, tuple[str, int | None]] = {}
    for each in map(str, bulk):
        shape = np.shape(bulk[each])
        if shape[:2] != (times, points):
            continue
        axes = entries.get(shape[-1]) if each == "stress" else {1: ["z"], 2: ["x", "y"]}.get(shape[-1])
        if len(shape) == 2:
            known[each] = each, None
        elif axes is not None:
            known |= {f"{each}_{axis}": (each, number) for number, axis in enumerate(axes)}
    if name not in known:
        raise RuptfxError(f"plots.{title}: field = '{name}': {nearest_name(name, [*others, *known])}")
    stored, component = known[name]

    def values(row: int) -> Array:
        result = bulk[stored].isel(time=row).values
        return np.asarray(result if component is None else result[..., component])

    return values, str(bulk[stored].attrs.get("units", "1"))


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
