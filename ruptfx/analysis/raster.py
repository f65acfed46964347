"""Fields of a mesh on square pixels."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

PIXELS = 1000  # along the longer side


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
