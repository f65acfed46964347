"""Cells adjacent to the facets of a mesh, and the mesh cut open along some of its facets."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ruptfx import RuptfxError


class Facets:
    """All facets of a mesh.

    Parameters
    ----------
    cells : ndarray of int, shape (cells, vertices per cell)
    local : list of tuple of int
        Vertices of the facets of one cell.

    Attributes
    ----------
    vertices : ndarray of int, shape (facets, vertices per facet)
        Sorted.
    cells : ndarray of int, shape (facets, 2)
        The adjacent cells; the second is -1 at the boundary.

    Raises
    ------
    RuptfxError
        More than two cells at one facet.
    """

    def __init__(self, cells: np.ndarray, local: list[tuple[int, ...]]) -> None:
        self._mesh = cells
        everything = np.concatenate([np.sort(cells[:, list(facet)], axis=1) for facet in local])
        self.vertices, label, count = np.unique(everything, axis=0, return_inverse=True, return_counts=True)
        if count.max(initial=0) > 2:
            raise RuptfxError(f"mesh: {count.max()} cells meet at one facet; at most two can")
        cell = np.argsort(label.ravel(), kind="stable") % len(cells)
        first = np.cumsum(count) - count
        second = cell[np.minimum(first + 1, len(cell) - 1)]
        self.cells = np.stack([cell[first], np.where(count == 2, second, -1)], axis=1)

    def find(self, facets: np.ndarray) -> np.ndarray:
        """Return the indices of facets given by their vertices in any order, -1 if unknown."""
        known = len(self.vertices)
        joined = np.concatenate([self.vertices, np.sort(facets, axis=1)])
        label = np.unique(joined, axis=0, return_inverse=True)[1].ravel()
        number = np.full(label.max(initial=-1) + 1, -1)
        number[label[:known]] = np.arange(known)
        return number[label[known:]]

    def cut(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cells that share no vertex across some facets, unless they are connected around the end of the cut.

        At every vertex of the cut, cells that can be reached from each other through facets that are not cut keep one
        vertex in common: a cut ends where it is not cut open, and may cross others.

        Parameters
        ----------
        along : ndarray of int
            Numbers of facets.

        Returns
        -------
        cells : ndarray of int, shape (cells, vertices per cell)
        origin : ndarray of int, shape (new vertices,)
            The vertex of which each added one is a copy.
        """
        cells = self._mesh
        touched = np.zeros(cells.max() + 1, dtype=bool)
        touched[self.vertices[along]] = True
        corner = np.full(cells.shape, -1)
        used = touched[cells]
        corner[used] = np.arange(used.sum())
        uncut = self.cells[:, 1] >= 0
        uncut[along] = False
        uncut &= touched[self.vertices].any(axis=1)
        pairs = [corner[cell[:, None], places(cells[cell], self.vertices[uncut])] for cell in self.cells[uncut].T]
        a, b = (pair[pairs[0] >= 0] for pair in pairs)
        _, label = connected_components(sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(used.sum(),) * 2), False)
        vertex = np.zeros(label.max(initial=-1) + 1, dtype=cells.dtype)
        vertex[label] = cells[used]
        is_copy = np.ones(len(vertex), dtype=bool)
        is_copy[np.unique(vertex, return_index=True)[1]] = False
        origin = vertex[is_copy]
        vertex[is_copy] = len(touched) + np.arange(len(origin))
        result = cells.copy()
        result[used] = vertex[label]
        return result, origin


def places(cells: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Return the local index of the vertices of facets in their cells, shape of `facets`."""
    return (cells[:, None, :] == facets[:, :, None]).argmax(axis=2)
