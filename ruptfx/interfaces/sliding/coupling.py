"""The matrix B of a mortar pairing, and the quantities of a pairing at its points."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from ruptfx.interfaces.sliding.surface import Floats, Integers
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

COLUMNS = 8  # rows of B are padded to a multiple of this
REACH = 10  # largest distance of paired surfaces, in facets of either side
OVERHANG = 0.02  # part of a facet: tolerated overhang at the ends of two aligned bodies that tilt
SLIVER = 1e-9  # part of a facet: smaller overlaps are not integrated


def whole(columns: int) -> int:
    """Return the next multiple of `COLUMNS`."""
    return -(-columns // COLUMNS) * COLUMNS


@cache
def _library() -> ctypes.CDLL:
    source = files("ruptfx.interfaces.sliding").joinpath("coupling.c").read_text()
    library = native.load("coupling", source)
    library.longest_column.restype = ctypes.c_long
    return library


@dataclass(frozen=True)
class Coupling:
    """Matrix B: the partner of a point is a weighted mean of nodes of the other side.

    Attributes
    ----------
    first : ndarray of int, shape (n,)
        First node of every row; 0 for points without a partner.
    values : ndarray, shape (n, width)
        Weights of the nodes, zero beyond the partner; the same number of entries in all rows.
    nodes : int
        Number of nodes of the other side.
    listed : ndarray of int, shape (n, width), optional
        Node of every entry, that of an entry without a weight being any node; default: consecutive nodes from `first`.
    """

    first: Integers
    values: Floats
    nodes: int
    listed: Integers | None = None

    @property
    def columns(self) -> Integers:
        """Node of every entry, shape (n, width)."""
        if self.listed is not None:
            return self.listed
        result: Integers = np.minimum(self.first[:, None] + np.arange(self.values.shape[1]), max(self.nodes - 1, 0))
        return result

    def __matmul__(self, nodal: Floats) -> Floats:
        """Return B times values at the nodes of the other side, shape (nodes, ...)."""
        if not self.nodes:
            return np.zeros((len(self.first), *nodal.shape[1:]))
        columns, nodal = self.columns, np.ascontiguousarray(nodal, dtype=float)
        result = np.zeros((len(self.first), *nodal.shape[1:]))
        components = int(np.prod(nodal.shape[1:]))
        _library().multiply(*self._arguments(columns), ctypes.c_long(components), *map(address, (nodal, result)))
        return result

    def squared(self) -> Coupling:
        """Return the matrix with the squares of all entries."""
        return Coupling(self.first, self.values**2, self.nodes, self.listed)

    def transposed(self) -> Coupling:
        """Return B': the points paired with every node of the other side, consecutive ones if B has such nodes."""
        n, first = len(self.first), np.zeros(self.nodes, dtype=np.int64)
        if self.listed is None:
            point, column = np.nonzero(self.values)
            node, values_in_order = self.columns[point, column], self.values[point, column]
            first[node[::-1]] = point[::-1]  # in order: the last assignment counts
            last = np.zeros(self.nodes, dtype=np.int64)
            last[node] = point
            values = np.zeros((self.nodes, whole(int(np.max(last - first, initial=0)) + 1)))
            values[node, point - first[node]] = values_in_order
            return Coupling(first, values, n)
        arguments, counts = self._arguments(self.listed), np.zeros((2, self.nodes), dtype=np.int64)
        width = whole(max(_library().longest_column(*arguments, address(counts[0])), 1))
        values, listed = np.zeros((self.nodes, width)), np.empty((self.nodes, width), dtype=np.int64)
        _library().transpose(
            *arguments,
            ctypes.c_long(self.nodes),
            ctypes.c_long(width),
            *map(address, (counts[1], first, values, listed)),
        )
        return Coupling(first, values, n, listed)

    def _arguments(self, columns: Integers) -> list[object]:
        """Return rows, width, values and nodes as arguments of coupling.c."""
        assert self.values.flags.c_contiguous and columns.flags.c_contiguous
        return [*map(ctypes.c_long, self.values.shape), address(self.values), address(columns)]

    def nearest(self) -> Integers:
        """Return the node with the largest weight of every point."""
        best = np.argmax(self.values, axis=1)
        if self.listed is None:
            return self.first + best
        return self.listed[np.arange(len(best)), best]


@dataclass(frozen=True)
class MortarPairing:
    """Mortar pairing at one time.

    Attributes
    ----------
    coupling : Coupling
        B; zero rows for points without a partner.
    weight : ndarray, shape (n,)
        Length or area of every point [m or m^2]; the tributary one for points without a partner.
    normal : ndarray, shape (n, dim)
        Unit normal of the minus side at the partner, out of the minus body.
    covered : ndarray of bool, shape (n,)
        Whether the point has a partner.
    """

    coupling: Coupling
    weight: Floats
    normal: Floats
    covered: NDArray[np.bool_]
