"""Fields of a mesh on square pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.results.record import Data

Array = np.ndarray
Points = Array | tuple[Array, Array]  # x and y

PIXELS = 1000  # along the longer side


def body_of_cells(bulk: Data) -> Array:
    """Return the index of the body of every cell; in files without it, of the last body of its points.

    A point where bodies are welded belongs to the first of them.
    """
    if "body_of_cell" in bulk:
        return bulk["body_of_cell"].values
    return np.asarray(bulk["body"].values[bulk["cells"].values].max(axis=1))


class Raster:
    """Linear interpolation from a mesh of triangles or quadrilaterals to square pixels, set up once for all fields.

    Interpolation of the field instead of its picture keeps fringes sharp where a cell covers much of a fringe.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    cells : ndarray, shape (m, 3) or (m, 4)
        Corners of the cells, in order around each; quadrilaterals are cut along a diagonal.
    pixels : int
        Number of pixels along the longer side.
    corners : (ndarray, ndarray), each of shape (2,), optional
        Lower left and upper right of the picture, which must contain all points. Default: the bounding box.
    """

    def __init__(
        self, points: Array, cells: Array, pixels: int = PIXELS, corners: tuple[Array, Array] | None = None
    ) -> None:
        low, high = corners or (points.min(axis=0), points.max(axis=0))
        pixel = (high - low).max() / pixels
        self.shape = tuple(np.maximum(np.round((high - low) / pixel), 1).astype(int)[::-1])
        self.extent = (low[0], high[0], low[1], high[1])
        # Corners in units of pixels: pixel (i, j) has its centre at (i, j).
        size = np.array(self.shape[::-1])
        place = (points - low) / (high - low) * size - 0.5
        x, y = np.ascontiguousarray(place.T)  # one by one they are gathered faster than in pairs
        boxes = [(along[cells].min(axis=1), along[cells].max(axis=1)) for along in (x, y)]
        first = np.maximum(np.ceil(np.stack([least for least, _ in boxes], axis=1) - 1e-9), 0).astype(int)
        last = np.minimum(np.floor(np.stack([most for _, most in boxes], axis=1) + 1e-9), size - 1).astype(int)
        box = np.maximum(last - first + 1, 0)
        # Every pixel in the bounding box of every cell, as one flat list of candidates.
        count = box.prod(axis=1)
        cell = np.repeat(np.arange(len(cells)), count)
        rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        i = first[cell, 0] + rank % box[cell, 0]
        j = first[cell, 1] + rank // box[cell, 0]
        triangle = cells[cell, :3]
        if cells.shape[1] == 4:
            a, b, c = ((x[corner], y[corner]) for corner in triangle.T)
            beyond = _turn(a, c, (i, j)) * _turn(a, c, b) < 0  # the diagonal, seen from the second corner
            triangle[beyond] = cells[cell[beyond]][:, [0, 2, 3]]
        a, b, c = ((x[corner], y[corner]) for corner in triangle.T)
        with np.errstate(divide="ignore", invalid="ignore"):
            second = _turn(a, (i, j), c) / _turn(a, b, c)
            third = _turn(a, b, (i, j)) / _turn(a, b, c)
        weights = np.stack([1 - second - third, second, third])
        inside = (weights > -1e-9).all(axis=0)
        self.pixel = (j * size[0] + i)[inside]
        self.corner = triangle[inside]
        self.weight = weights[:, inside].T

    def __call__(self, values: Array) -> Array:
        """Return the image of nodal values, shape (rows, columns), lowest row first; NaN outside the mesh."""
        image = np.full(self.shape[0] * self.shape[1], np.nan)
        image[self.pixel] = (values[self.corner] * self.weight).sum(axis=1)
        return image.reshape(self.shape)


def _turn(a: Points, b: Points, c: Points) -> Array:
    """Return twice the area of the triangle a, b, c, positive if counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
