"""Figures of the two bodies: isochromatic fringes and particle velocity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.photoelasticity import fringe_order, intensity
from ruptfx.plots.style import (
    WAVE_MAP,
    WIDTH,
    Array,
    default_times,
    letter,
    nearest,
    new_figure,
    note,
    remark,
    scale,
    styled,
)
from ruptfx.record import Record

PIXELS = 1000  # across a panel


class Raster:
    """Linear interpolation from a mesh of triangles or quadrilaterals to square pixels, set up once for all fields.

    Interpolating the field and not its picture keeps fringes sharp where a cell holds a good part of one.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    cells : ndarray, shape (m, 3) or (m, 4)
        Corners of the cells, in order around each; quadrilaterals are cut along a diagonal.
    pixels : int
        Number of pixels along the longer side.
    """

    def __init__(self, points: Array, cells: Array, pixels: int = PIXELS) -> None:
        triangles = cells if cells.shape[1] == 3 else np.vstack([cells[:, :3], cells[:, [0, 2, 3]]])
        low, high = points.min(axis=0), points.max(axis=0)
        pixel = (high - low).max() / pixels
        self.shape = tuple(np.maximum(np.round((high - low) / pixel), 1).astype(int)[::-1])
        self.extent = (low[0], high[0], low[1], high[1])
        # Corners in units of pixels: pixel (i, j) has its centre at (i, j).
        size = np.array(self.shape[::-1])
        corners = ((points - low) / (high - low) * size - 0.5)[triangles]
        first = np.maximum(np.ceil(corners.min(axis=1) - 1e-9), 0).astype(int)
        last = np.minimum(np.floor(corners.max(axis=1) + 1e-9), size - 1).astype(int)
        box = np.maximum(last - first + 1, 0)
        # Every pixel in the bounding box of every triangle, as one flat list of candidates.
        count = box.prod(axis=1)
        triangle = np.repeat(np.arange(len(triangles)), count)
        rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        i = first[triangle, 0] + rank % box[triangle, 0]
        j = first[triangle, 1] + rank // box[triangle, 0]
        a, b, c = corners[triangle].transpose(1, 2, 0)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            second = ((i - a[0]) * (c[1] - a[1]) - (j - a[1]) * (c[0] - a[0])) / area
            third = ((b[0] - a[0]) * (j - a[1]) - (b[1] - a[1]) * (i - a[0])) / area
        weights = np.stack([1 - second - third, second, third])
        inside = (weights > -1e-9).all(axis=0)
        self.pixel = (j * size[0] + i)[inside]
        self.corner = triangles[triangle[inside]]
        self.weight = weights[:, inside].T

    def __call__(self, values: Array) -> Array:
        """Image of nodal values, shape (rows, columns), lowest row first; NaN outside the mesh."""
        image = np.full(self.shape[0] * self.shape[1], np.nan)
        image[self.pixel] = (values[self.corner] * self.weight).sum(axis=1)
        return image.reshape(self.shape)


class Plates:
    """What makes fringes of stress: the fringe constants of the bodies and the thickness of the plates.

    Parameters
    ----------
    record : Record
    fringe_constant, thickness : float, optional
        For all bodies [N/m], and of the plates [m], instead of those of the case.

    Attributes
    ----------
    constants : dict of str to float
        By body [N/m]; NaN where it is not known.
    thickness : float
        [m], NaN where it is not known.
    missing : str
        Why there are no fringes; empty where there are.
    """

    def __init__(self, record: Record, fringe_constant: float | None = None, thickness: float | None = None) -> None:
        case, self._bulk = record.case, record.bulk
        given = case.get("materials", {})
        self.constants = {}
        for name in map(str, np.atleast_1d(self._bulk.attrs.get("bodies", ["bodies"]))):
            material = given.get(name, given.get("default", {}))
            self.constants[name] = float(fringe_constant or material.get("fringe_constant", np.nan))
        self.thickness = float(thickness or case.get("output", {}).get("plate_thickness", np.nan))
        self.missing = ""
        if "fringe" not in self._bulk or self._bulk.sizes.get("component") != 2:
            self.missing = "no fringes: they are of stresses in a plane"
        elif not np.isfinite(list(self.constants.values())).any():
            self.missing = "no fringes: no material\nhas a fringe_constant"
        elif not np.isfinite(self.thickness):
            self.missing = "no fringes:\noutput.plate_thickness is not given"

    def order(self, row: int) -> Array:
        """Fringe order at every point of a snapshot."""
        constant = np.array(list(self.constants.values()))[self._bulk["body"].values]
        return fringe_order(self._bulk["fringe"].isel(time=row).values, constant, self.thickness)

    def per_fringe(self) -> str:
        """Stress of a fringe, of every body where they differ."""
        texts = {}
        for name, constant in self.constants.items():
            size, unit = scale(constant / self.thickness, "Pa")
            known = np.isfinite(constant)
            texts[name] = f"{constant / self.thickness / size:.3g} {unit} per fringe" if known else "no fringe constant"
        if len(set(texts.values())) == 1:
            return next(iter(texts.values()))
        return ", ".join(f"{text} ({name})" for name, text in texts.items())


def most_fringes(record: Record) -> float:
    """Largest fringe order at the last snapshot but for a hundredth of the points; 0 where there are none."""
    plates = Plates(record)
    if plates.missing or not record.bulk.sizes["time"]:
        return 0.0
    return float(np.nanquantile(plates.order(-1), 0.99))


@styled
def fringes(
    record: Record,
    time: float | Sequence[float] | None = None,
    fringe_constant: float | None = None,
    thickness: float | None = None,
    field: str = "dark",
) -> Figure:
    """Isochromatic fringes as a polariscope shows them, with the interface drawn.

    Bodies whose material has no fringe constant are left blank; without a constant or the thickness of the plates the
    figure says what is missing. Where the initial stress of the bodies is assumed it says so, too.

    Parameters
    ----------
    record : Record
    time : float or sequence of float, optional
        Times [s]; the nearest snapshots are drawn. Default: four while the rupture runs.
    fringe_constant, thickness : float, optional
        Of all bodies [N/m], and of the plates [m]. Default: `fringe_constant` of the materials and
        `output.plate_thickness` of the case.
    field : str
        "dark" or "light" field of the polariscope.
    """
    plates = Plates(record, fringe_constant, thickness)
    if plates.missing:
        return _without(plates.missing)

    def light(row: int, raster: Raster) -> Array:
        return intensity(raster(plates.order(row)), field)

    label = f"{field.capitalize()}-field intensity; {plates.per_fringe()}"
    figure = _panels(record, time, light, label, "#d9480f", cmap="gray", vmin=0, vmax=1)
    stress = str(record.bulk.attrs.get("initial_stress", ""))
    remark(figure, f"Initial stress {stress}." if stress.startswith("assumed") else "")
    return figure


@styled
def wavefield(record: Record, time: float | Sequence[float] | None = None) -> Figure:
    """Particle speed in the two bodies, with the interface drawn: shear Mach fronts show as straight lines.

    Parameters
    ----------
    record : Record
    time : float or sequence of float, optional
        Times [s]; the nearest snapshots are drawn. Default: four while the rupture runs.
    """
    if "velocity" not in record.bulk:
        return _without("no velocities were saved")

    def speed(row: int, raster: Raster) -> Array:
        return raster(np.linalg.norm(record.bulk["velocity"].isel(time=row).values, axis=-1))

    return _panels(record, time, speed, "Particle speed (m/s)", "white", cmap=WAVE_MAP, vmin=0)


def _panels(
    record: Record,
    time: float | Sequence[float] | None,
    picture: Callable[[int, Raster], Array],
    label: str,
    line: str,
    **look: Any,
) -> Figure:
    """One panel per time, in two columns if there are several, with one common scale."""
    bulk = record.bulk
    saved = bulk["time"].values
    rows = default_times(record, saved, 4) if time is None else nearest(saved, np.atleast_1d(np.asarray(time)))
    if not len(rows):
        return _without("no snapshot was saved")
    points = bulk["points"].values
    raster = Raster(points, bulk["cells"].values)
    images = [picture(int(row), raster) for row in rows]
    extend = "neither"
    if "vmax" not in look:
        # A few bright pixels at the tip must not darken the waves.
        look["vmax"] = max(np.nanquantile(image, 0.998) for image in images) or 1.0
        extend = "max"
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(points, axis=0), "m"), scale(saved, "s")
    columns = min(len(rows), 2)
    lines = -(-len(rows) // columns)
    width = (WIDTH - 0.6) / columns
    height = lines * (0.3 + width * raster.shape[0] / raster.shape[1]) + 0.9
    height += 0.35 * (len(rows) % columns)  # labels below a panel that has none under it
    figure, axes = new_figure(lines, columns, height, sharex=True, sharey=True)
    extent = [value / x_size for value in raster.extent]
    for ax, row, image in zip(axes.ravel(), rows, images, strict=False):
        ax.set_facecolor("#dbe4ec")  # what has no value is no shade of the picture
        shown = ax.imshow(image, origin="lower", extent=extent, interpolation="antialiased", **look)
        for data in record.interfaces.values():
            ax.plot(data["x"].values / x_size, data["y"].values / x_size, color=line, lw=0.6)
        ax.set_title(f"{saved[row] / t_size:.3g} {t_unit}", loc="right")
    for ax in axes.ravel()[:len(rows)][-columns:]:
        ax.set_xlabel(f"x ({x_unit})")
        ax.tick_params(labelbottom=True)
    for ax in axes[:, 0]:
        ax.set_ylabel(f"y ({x_unit})")
    for ax in axes.ravel()[len(rows):]:
        ax.set_visible(False)
    figure.colorbar(
        shown, ax=axes.ravel().tolist(), label=label, location="bottom", shrink=0.4, aspect=30, extend=extend
    )
    letter(axes.ravel()[: len(rows)])
    return figure


def _without(text: str) -> Figure:
    figure, axes = new_figure(1, 1, 2.0, WIDTH / 2)
    axes[0, 0].set(xlabel="x (m)", ylabel="y (m)")
    note(axes[0, 0], text)
    return figure
