"""Mortar pairing: a dual mortar on the nodes of the plus side transfers tractions, frozen between updates.

Tractions are values at the nodes of the plus side, with the dual basis psi of their Lagrange basis l on every facet,

    psi_a = D_a sum_b (M^-1)_ab l_b,   M_ab = int l_a l_b ds,   D_a = int l_a ds,

so that w_i = sum of D_a is the length of a point and its partner is the weighted mean

    x-_i = sum_j B_ij x-_j,   w_i B_ij = int psi_i N_j ds,

with the basis N of the facets of the minus side at the projections of the points along the normal of the chord. Facets
are cut at the projections of vertices of the minus side, so that a uniform stress transfers to round-off. The
tangent of a point is the mean tangent of the *minus* side with the same psi: then J = frame (u+ - B u-) is the gradient
of the gap at closed points, also after sliding, and a frozen operator does no work in sliding.

Where a facet overhangs the end of the minus side each node is treated by itself: nodes with a projection are paired
with it; the others carry nothing.

`mortar.c` contains the code; the tests have a NumPy version.

Source: Wohlmuth (2000), Popp et al. (2009) for dual mortars; here on GLL nodes, with frames of the minus side.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.interfaces.sliding.surface import Floats, Integers, Surface
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

REACH = 10  # largest distance of paired surfaces, in facets of either side
OVERHANG = 0.02  # part of a facet: tolerated overhang at the ends of two aligned bodies that tilt
SLIVER = 1e-9  # part of a facet: shorter overlaps are not integrated
COLUMNS = 8  # rows of B are padded to a multiple of this


def whole(columns: int) -> int:
    """Return the next multiple of `COLUMNS`."""
    return -(-columns // COLUMNS) * COLUMNS


@dataclass(frozen=True)
class Coupling:
    """Matrix B: the partner of a point is a weighted mean of consecutive nodes of the other side.

    Attributes
    ----------
    first : ndarray of int, shape (n,)
        First node of every row; 0 for points without a partner.
    values : ndarray, shape (n, columns)
        Weights of the nodes from there on, zero beyond the partner; the same number of columns in all rows.
    nodes : int
        Number of nodes of the other side.
    """

    first: Integers
    values: Floats
    nodes: int

    def __matmul__(self, nodal: Floats) -> Floats:
        """Return B times values at the nodes of the other side, shape (nodes, ...)."""
        if not self.nodes:
            return np.zeros((len(self.first), *nodal.shape[1:]))
        columns = np.minimum(self.first[:, None] + np.arange(self.values.shape[1]), self.nodes - 1)
        values: Floats = np.einsum("ij,ij...->i...", self.values, nodal[columns])
        return values

    def squared(self) -> Coupling:
        """Return the matrix with the squares of all entries."""
        return Coupling(self.first, self.values**2, self.nodes)

    def transposed(self) -> Coupling:
        """Return B': consecutive points paired with every node of the other side."""
        point, column = np.nonzero(self.values)
        node = self.first[point] + column
        first, last = np.zeros((2, self.nodes), dtype=np.int64)
        first[node[::-1]], last[node] = point[::-1], point  # in order: the last assignment counts
        values = np.zeros((self.nodes, whole(int(np.max(last - first, initial=0)) + 1)))
        values[node, point - first[node]] = self.values[point, column]
        return Coupling(first, values, len(self.first))

    def nearest(self) -> Integers:
        """Return the node with the largest weight of every point."""
        return self.first + np.argmax(self.values, axis=1)


@dataclass(frozen=True)
class MortarPairing:
    """Mortar pairing at one time.

    Attributes
    ----------
    coupling : Coupling
        B; zero rows for points without a partner.
    weight : ndarray, shape (n,)
        Length of every point [m]; the tributary length for points without a partner.
    tangent : ndarray, shape (n, 2)
        Unit tangent of the minus side.
    covered : ndarray of bool, shape (n,)
        Whether the point has a partner.
    """

    coupling: Coupling
    weight: Floats
    tangent: Floats
    covered: NDArray[np.bool_]


def dual_basis(plus: Surface, at: Floats, weights: Floats) -> Floats:
    """Return coefficients D_a (M^-1)_ab of psi_a in the Lagrange basis, by quadrature; shape (facets, nodes, nodes)."""
    table, corners = plus.basis.values(at), plus.points[plus.numbers]
    metric = np.linalg.norm(np.einsum("gb,fbc->fgc", plus.basis.slopes(at), corners), axis=2) * weights
    mass = np.einsum("fg,ga,gb->fab", metric, table, table)
    result: Floats = np.einsum("fg,ga->fa", metric, table)[:, :, None] * np.linalg.inv(mass)
    return result


class Mortar:
    """The mortar coupling of two surfaces."""

    def __init__(self, plus: Surface, minus: Surface) -> None:
        self.plus, self.minus = plus, minus
        basis, corners = plus.basis, plus.points[plus.numbers]
        # The same points as for a facet that overlaps one facet only: matching nodes are then paired exactly.
        self._gauss = at, weights = legendre.leggauss(plus.order + -(-minus.order // 2) + 2)
        # Legendre coefficients of the dual basis, and of the coordinates of the nodes.
        self._dual = np.ascontiguousarray(dual_basis(plus, at, weights) @ basis.inverse.T)
        self._shape = np.ascontiguousarray(np.einsum("ka,fac->fck", basis.inverse, corners))
        self._nodal, self._length = plus.shares, plus.lengths
        macros = {
            "PLUS": plus.order, "MINUS": minus.order, "GAUSS": len(at), "REACH": REACH, "OVERHANG": OVERHANG,
            "SLIVER": SLIVER,
        }  # fmt: skip
        source = files("ruptfx.interfaces.sliding").joinpath("mortar.c").read_text()
        self._library = native.load("mortar", source, macros)
        self._library.overlaps.restype = self._library.couple.restype = ctypes.c_long
        self._groups = np.zeros(3 * minus.facets)
        self._grow(4 * (plus.facets + minus.facets))

    def _grow(self, capacity: int) -> None:
        """Allocate arrays for overlaps: pairs of facets, and their start and end."""
        self._pair, self._ends = np.zeros((2, capacity), dtype=np.int64), np.zeros((2, capacity))

    def find(self, plus: Floats, minus: Floats) -> MortarPairing:
        """Return the pairing for given coordinates of the nodes.

        Parameters
        ----------
        plus, minus : ndarray, shapes (n, 2) and (nodes of the minus side, 2)
            Coordinates of both surfaces, in the order of their chains [m].

        Raises
        ------
        RuptfxError
            A facet that faces a surface twice, or a folded one.
        """
        plus, minus = np.ascontiguousarray(plus), np.ascontiguousarray(minus)
        pieces, share = self._overlaps(plus, minus)
        if np.any(share > 1 + 1e-6):
            x, y = plus[self.plus.numbers][np.argmax(share)].mean(axis=0)
            raise RuptfxError(
                f"the interface faces two parts of the other surface at ({x:.6g}, {y:.6g}) m: it must not fold back "
                "within ten elements of an interface that slides"
            )
        first, columns = self._rows(pieces)
        n = len(plus)
        values, weight, tangent = np.zeros((n, columns)), np.zeros(n), np.zeros((n, 2))
        basis, other = self.plus.basis, self.minus.basis
        lost = self._library.couple(
            ctypes.c_long(pieces), *map(_pointer, (plus, minus, *self._pair, *self._ends, share)),
            *map(_pointer, (basis.inverse, other.inverse, *self._gauss, basis.points)),
            *map(_pointer, (self._dual, self._shape, self._nodal, first)), ctypes.c_long(columns),
            *map(_pointer, (values, weight, tangent)),
        )  # fmt: skip
        if lost >= 0:
            x, y = plus[self.plus.numbers][lost].mean(axis=0)
            raise RuptfxError(
                f"what the interface faces at ({x:.6g}, {y:.6g}) m was not found: the side of an element there is "
                "folded or bent too much; use a smoother surface, or smaller elements"
            )
        covered = weight > SLIVER * self._length
        if not covered.all():
            values[~covered], weight[~covered] = 0.0, self._length[~covered]
            tangent[~covered] = self._own_tangent(plus)[~covered]
        values /= weight[:, None]
        tangent /= np.hypot(*tangent.T)[:, None]
        return MortarPairing(Coupling(first, values, len(minus)), weight, tangent, covered)

    def _overlaps(self, plus: Floats, minus: Floats) -> tuple[int, Floats]:
        """Return the number of overlaps, and the covered part of every facet."""
        share = np.zeros(self.plus.facets)
        while True:
            capacity = self._pair.shape[1]
            pieces = self._library.overlaps(
                ctypes.c_long(self.plus.facets), ctypes.c_long(self.minus.facets),
                *map(_pointer, (plus, minus, self._groups)), ctypes.c_long(capacity),
                *map(_pointer, (*self._pair, *self._ends, share)),
            )  # fmt: skip
            if pieces <= capacity:
                return pieces, share
            self._grow(pieces)

    def _rows(self, pieces: int) -> tuple[Integers, int]:
        """Return the first column of every row, and the number of columns of the longest one."""
        facets, order = self.plus.facets, self.plus.order
        begin, end = np.full(facets, len(self.minus.nodes)), np.zeros(facets, dtype=np.int64)
        own, opposite = self._pair[:, :pieces]
        np.minimum.at(begin, own, opposite * self.minus.order)
        np.maximum.at(end, own, (opposite + 1) * self.minus.order + 1)
        of_node = np.repeat(begin, order), np.repeat(end, order)
        first, last = np.append(of_node[0], begin[-1]), np.append(of_node[1], end[-1])
        inner = np.arange(1, facets) * order  # nodes of two facets
        first[inner], last[inner] = np.minimum(begin[1:], begin[:-1]), np.maximum(end[1:], end[:-1])
        columns = int(np.max(last - first, initial=1))
        return np.where(last > 0, first, 0), whole(columns)

    def _own_tangent(self, plus: Floats) -> Floats:
        """Return the mean tangent of the plus side at its nodes, not normalised."""
        slopes = np.einsum("gb,fbc->fgc", self.plus.basis.slopes(self.plus.basis.points), plus[self.plus.numbers])
        tangent = np.zeros_like(plus)
        np.add.at(tangent, self.plus.numbers, slopes)
        return tangent


def _pointer(array: Floats | Integers) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return address(array)
