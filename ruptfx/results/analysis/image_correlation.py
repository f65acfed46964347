"""Digital image correlation: displacements and strains from two pictures of a speckled surface.

The correlation is that of scikit-image (iterative Lucas-Kanade, which minimises the difference of grey levels over a
square subset around every pixel); strains are slopes of planes fitted to the displacements over a square window. The
same functions accept pictures of an experiment and synthetic ones of a run (`photographed`), whose true strains are
known: the difference is the error of the method in an experiment.

Rows of images go up, as y does.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    map_coordinates,
    maximum_filter,
    uniform_filter,
    uniform_filter1d,
)  # fmt: skip
from scipy.signal import savgol_filter
from scipy.spatial import cKDTree

from ruptfx import RuptfxError
from ruptfx.results.analysis.raster import Raster, body_of_cells

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Record

Array = np.ndarray
GREYS = 255


def displacements(before: Array, after: Array, subset: int) -> tuple[Array, Array]:
    """Return the displacement of every pixel of the first image, along x and y [pixels].

    Parameters
    ----------
    before, after : ndarray, shape (rows, columns)
        Grey levels; brightness and contrast of the whole picture may differ.
    subset : int
        Pixels along the side of the square that is followed, odd.

    Raises
    ------
    RuptfxError
        Images of different size, a subset that is even or larger than they are, an image without contrast, or
        scikit-image is missing.
    """
    if before.shape != after.shape or before.ndim != 2:
        raise RuptfxError(
            f"image correlation: images of {_size(before)} and {_size(after)}: both must be grey and of the same size; "
            "crop them alike"
        )
    if subset < 5 or subset % 2 == 0 or subset > min(before.shape):
        raise RuptfxError(
            f"image correlation: subset = {subset}: must be odd, 5 or more, and fit into the image of {_size(before)}"
        )
    if np.ptp(before) == 0 or np.ptp(after) == 0:
        raise RuptfxError(
            "image correlation: an image has no contrast: there is nothing to follow; give one with speckles"
        )
    try:
        from skimage.registration import optical_flow_ilk
    except ImportError:
        raise RuptfxError("image correlation needs scikit-image: pip install 'ruptfx[dic]'") from None
    # Of other light, or of another depth of grey levels, the second picture is the same but for its scale.
    still, moved = ((image - image.mean()) / image.std() for image in (before, after))
    along_y, along_x = optical_flow_ilk(still, moved, radius=subset // 2, num_warp=10, dtype=np.float64)
    return along_x, along_y


def correlation(before: Array, after: Array, along_x: Array, along_y: Array, subset: int) -> Array:
    """Return the normalised cross-correlation of every subset with its displaced picture, from -1 to 1.

    Parameters
    ----------
    before, after : ndarray, shape (rows, columns)
        Grey levels.
    along_x, along_y : ndarray, same shape
        Displacement of every pixel of the first image [pixels].
    subset : int
        Pixels along the side of the square, odd.

    Returns
    -------
    ndarray
        NaN where the subset leaves one of the images, or has no contrast.
    """
    rows, columns = np.indices(before.shape).astype(float)
    there = np.stack([rows + along_y, columns + along_x])
    seen = map_coordinates(np.asarray(after, dtype=float), there, order=3, mode="nearest")
    last = np.array(before.shape, dtype=float)[:, None, None] - 1
    outside = np.any((there < -0.5) | (there > last + 0.5), axis=0)

    def mean(values: Array) -> Array:
        return np.asarray(uniform_filter(values, subset, mode="nearest"))

    # About their overall means: differences of large squares would round.
    one, other = before - np.mean(before), seen - np.mean(seen)
    both = mean(one * other) - mean(one) * mean(other)
    squares = (mean(one**2) - mean(one) ** 2) * (mean(other**2) - mean(other) ** 2)
    smallest = 1e-12 * (np.var(one) * np.var(other))
    with np.errstate(all="ignore"):
        result = np.where(squares > smallest, both / np.sqrt(squares), np.nan)
    half = subset // 2
    is_complete = np.zeros(before.shape, dtype=bool)
    is_complete[half : before.shape[0] - half, half : before.shape[1] - half] = True
    return np.where(is_complete & ~spread(outside, subset), result, np.nan)


def spread(lost: Array, side: int) -> Array:
    """Return which squares of an odd side contain a lost pixel, in the shape of the image."""
    return np.asarray(maximum_filter(lost, side, mode="constant", cval=False))


def strains(along_x: Array, along_y: Array, window: int) -> dict[str, Array]:
    """Return strains of planes fitted to the displacements [pixels] over an odd window of pixels.

    Returns
    -------
    dict of ndarray
        xx, yy, and xy as a component of the tensor; NaN where the window leaves the image.

    Raises
    ------
    RuptfxError
        A window that is even or does not fit into the image.
    """
    if window < 3 or window % 2 == 0 or window > min(along_x.shape):
        raise RuptfxError(
            f"image correlation: window = {window}: must be odd, 3 or more, and fit into the image of {_size(along_x)}"
        )

    def slope(field: Array, axis: int) -> Array:
        result = savgol_filter(field, window, 1, deriv=1, axis=axis, mode="nearest")
        result = uniform_filter1d(result, window, axis=1 - axis, mode="nearest")
        half = window // 2
        for side in (slice(None, half), slice(-half, None)):
            result[side] = result[:, side] = np.nan
        return np.asarray(result)

    shear = 0.5 * (slope(along_x, 0) + slope(along_y, 1))
    return {"xx": slope(along_x, 1), "yy": slope(along_y, 0), "xy": shear}


def speckle(shape: tuple[int, int], size: float, seed: int = 0) -> Array:
    """Return a picture of random speckles, grey levels from 0 to 255.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    size : float
        Of a speckle [pixels].
    """
    waves = gaussian_filter(np.random.default_rng(seed).normal(size=shape), 0.35 * size, mode="wrap")
    return GREYS / (1 + np.exp(-4 * waves / waves.std()))


def photographed(image: Array, along_x: Array, along_y: Array, noise: float = 0.0, seed: int = 1) -> Array:
    """Return the picture after a displacement of its pixels, with noise, as whole grey levels.

    The material at x was at X = x - u(X), solved by iteration: displacements vary by less than a pixel from pixel to
    pixel.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Before.
    along_x, along_y : ndarray, same shape
        Displacement [pixels].
    noise : float
        Standard deviation of the grey levels.
    """
    rows, columns = np.indices(image.shape).astype(float)
    x, y = columns - along_x, rows - along_y
    for _ in range(4):
        there = [np.clip(y, 0, image.shape[0] - 1), np.clip(x, 0, image.shape[1] - 1)]
        x = columns - map_coordinates(along_x, there, order=1, mode="nearest")
        y = rows - map_coordinates(along_y, there, order=1, mode="nearest")
    seen = map_coordinates(image, [y, x], order=5, mode="nearest")
    return np.clip(np.round(seen + noise * np.random.default_rng(seed).normal(size=image.shape)), 0, GREYS)


def pixel_displacements(record: Record, moved: Array, pixel: float) -> tuple[Array, Array, Array, tuple[Array, Array]]:
    """Return displacements on square pixels, from those of the nodes of the snapshots.

    Parameters
    ----------
    moved : ndarray, shape (nodes, 2)
        [m]
    pixel : float
        [m]

    Returns
    -------
    along_x, along_y : ndarray, shape (rows, columns)
        [pixels]; outside of the bodies those of the nearest pixel.
    plate : ndarray of bool, same shape
        Whether a pixel is on a body.
    (x, y) : tuple of ndarray
        Centres of columns and rows [m].
    """
    points = record.bulk["points"].values
    pixels = round(float(np.ptp(points, axis=0).max()) / pixel)
    along: list[Array | None] = [None, None]
    for fields in _of_bodies(record, moved / pixel, pixels):
        along = [_filled(known, part) for known, part in zip(along, fields, strict=True)]
    moved_x, moved_y = (part for part in along if part is not None)
    plate = np.isfinite(moved_x)
    nearest = tuple(distance_transform_edt(~plate, return_distances=False, return_indices=True))
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    rows, columns = ((np.arange(n) + 0.5) / n for n in plate.shape)
    return moved_x[nearest], moved_y[nearest], plate, (left + columns * (right - left), bottom + rows * (top - bottom))


def _of_bodies(record: Record, moved: Array, pixels: int) -> Iterator[list[Array]]:
    """Yield both components on the pixels of each body: interpolation must not cross interfaces, where they jump."""
    bulk = record.bulk
    points, cells, body = bulk["points"].values, bulk["cells"].values, body_of_cells(bulk)
    corners = (points.min(axis=0), points.max(axis=0))
    for number in np.unique(body):
        raster = Raster(points, cells[body == number], pixels, corners)
        yield [raster(part) for part in moved.T]


def experiment(  # noqa: PLR0913
    record: Record,
    row: int,
    pixel: float,
    subset: int = 21,
    window: int | None = None,
    noise: float = 2.0,
    speckle_size: float = 4.0,
    seed: int = 0,
    since: int | None = None,
) -> xarray.Dataset:
    """Return measured and true displacements and strains of a synthetic image-correlation experiment on a run.

    A speckled picture of the plates at the start, or at another snapshot, and one after the displacement of the
    snapshot, both with noise, are correlated.

    Parameters
    ----------
    row : int
        Index of the snapshot.
    pixel : float
        Size of a pixel on the plates [m].
    subset, window : int
        Pixels of a subset and of a window for strains (as large by default), odd.
    noise : float
        Standard deviation of the grey levels, of 255.
    speckle_size : float
        [pixels].
    since : int, optional
        Which snapshot the first picture is of.

    Returns
    -------
    xarray.Dataset
        Against `y` and `x` [m]: `measured_xx`, `true_xx` and so on for yy and xy, and `distance` from the interfaces
        [m]; NaN where there is no plate, or no whole window.

    Raises
    ------
    RuptfxError
        No plates in a plane.
    """
    import xarray

    bulk = record.bulk
    if bulk.sizes.get("component") != 2:
        raise RuptfxError(f"{record.path}: image correlation is of displacements in a plane; the run has none")
    points = bulk["points"].values
    pixels = round(float(np.ptp(points, axis=0).max()) / pixel)
    if pixels < 2 * subset:
        raise RuptfxError(
            f"image correlation: the plates have {pixels} pixels of {pixel:g} m, less than two subsets; take smaller "
            "pixels"
        )
    moved = bulk["displacement"].isel(time=row).values
    if since is not None:
        moved = moved - bulk["displacement"].isel(time=since).values
    true: dict[str, Array] = {}
    for fields in _of_bodies(record, moved / pixel, pixels):
        (xy, xx), (yy, yx) = (np.gradient(part) for part in fields)
        here = {"xx": xx, "yy": yy, "xy": 0.5 * (xy + yx)}
        true = {name: _filled(true.get(name), part) for name, part in here.items()}
    moved_x, moved_y, plate, (x, y) = pixel_displacements(record, moved, pixel)
    first = speckle(plate.shape, speckle_size, seed)
    still = np.zeros(plate.shape)
    before = photographed(first, still, still, noise, seed + 1)
    after = photographed(first, moved_x, moved_y, noise, seed + 2)
    result = strains(*displacements(before, after, subset), window or subset)
    variables = {f"true_{name}": (("y", "x"), values) for name, values in true.items()}
    variables |= {f"measured_{name}": (("y", "x"), np.where(plate, values, np.nan)) for name, values in result.items()}
    faces = [np.column_stack([data["x"].values, data["y"].values]) for data in record.interfaces.values()]
    if faces:
        grid = np.column_stack([part.ravel() for part in np.meshgrid(x, y)])
        away = cKDTree(_dense(np.concatenate(faces), pixel)).query(grid)[0].reshape(plate.shape)
        variables["distance"] = (("y", "x"), away)
    return xarray.Dataset(
        {
            name: (dims, values, {
                "units": "m" if name == "distance" else "1", "long_name": name.replace("_", " strain "),
            })
            for name, (dims, values) in variables.items()
        },
        {"y": ("y", y, {"units": "m"}), "x": ("x", x, {"units": "m"})},
        {"subset": subset * pixel, "pixel": pixel, "noise": noise, "time": float(bulk["time"][row])},
    )  # fmt: skip


def errors(data: xarray.Dataset, component: str, edges: Array) -> tuple[Array, Array]:
    """Return bias and noise of a strain, by distance from the interfaces.

    Parameters
    ----------
    data : xarray.Dataset
        Of `experiment`.
    component : str
        xx, yy or xy.
    edges : ndarray, shape (n + 1,)
        Of the bins of distance [m].

    Returns
    -------
    bias, noise : ndarray, shape (n,)
        Mean and standard deviation of measured minus true strain; NaN in empty bins.
    """
    difference = (data[f"measured_{component}"] - data[f"true_{component}"]).values.ravel()
    away = data["distance"].values.ravel()
    good = np.isfinite(difference)
    number = np.digitize(away[good], edges) - 1
    bins = [difference[good][number == n] for n in range(len(edges) - 1)]
    return (
        np.array([np.mean(values) if len(values) else np.nan for values in bins]),
        np.array([np.std(values) if len(values) else np.nan for values in bins]),
    )


def _filled(known: Array | None, part: Array) -> Array:
    """Fill the NaN of the known values from `part`."""
    return part if known is None else np.where(np.isnan(known), part, known)


def _dense(points: Array, spacing: float) -> Array:
    """Return points of a line, no further apart than a spacing."""
    steps = np.maximum(np.ceil(np.linalg.norm(np.diff(points, axis=0), axis=1) / spacing), 1).astype(int)
    parts = [a + (b - a) * np.arange(n)[:, None] / n for a, b, n in zip(points[:-1], points[1:], steps, strict=True)]
    return np.concatenate([*parts, points[-1:]])


def _size(image: Array) -> str:
    return " x ".join(str(length) for length in image.shape[1::-1]) + (" x colours" if image.ndim > 2 else "")
