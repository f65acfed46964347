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
from importlib.resources import files

import numpy as np
from numpy.polynomial import legendre

from ruptfx import RuptfxError
from ruptfx.interfaces.sliding.coupling import OVERHANG, REACH, SLIVER, Coupling, MortarPairing, whole
from ruptfx.interfaces.sliding.mortar_surfaces import SurfaceMortar
from ruptfx.interfaces.sliding.surface import Floats, Integers, Surface
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address


def dual_basis(plus: Surface, at: Floats, weights: Floats) -> Floats:
    """Return coefficients D_a (M^-1)_ab of psi_a in the Lagrange basis, by quadrature; shape (facets, nodes, nodes)."""
    table, corners = plus.basis.values(at), plus.points[plus.numbers]
    metric = np.linalg.norm(np.einsum("gb,fbc->fgc", plus.basis.slopes(at), corners), axis=2) * weights
    mass = np.einsum("fg,ga,gb->fab", metric, table, table)
    result: Floats = np.einsum("fg,ga->fa", metric, table)[:, :, None] * np.linalg.inv(mass)
    return result


class Mortar:
    """The mortar coupling of the two sides of an interface: of chains in a plane, of surfaces in space."""

    def __init__(self, plus: Surface, minus: Surface) -> None:
        self._mortar = (LineMortar if plus.points.shape[1] == 2 else SurfaceMortar)(plus, minus)

    def find(self, plus: Floats, minus: Floats) -> MortarPairing:
        """Return the pairing for coordinates of the nodes, shapes (n, dim) and (nodes of the minus side, dim) [m]."""
        return self._mortar.find(plus, minus)


class LineMortar:
    """The mortar coupling of two chains."""

    def __init__(self, plus: Surface, minus: Surface) -> None:
        self.plus, self.minus = plus, minus
        basis, corners = plus.basis, plus.points[plus.numbers]
        # The same points as for a facet that overlaps one facet only: matching nodes are then paired exactly.
        self._gauss = at, weights = legendre.leggauss(plus.order + -(-minus.order // 2) + 2)
        # Legendre coefficients of the dual basis, and of the coordinates of the nodes.
        self._dual = np.ascontiguousarray(dual_basis(plus, at, weights) @ basis.inverse.T)
        self._shape = np.ascontiguousarray(np.einsum("ka,fac->fck", basis.inverse, corners))
        self._nodal, self._length = plus.shares, plus.measures
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
            tangent[~covered] = self.plus.sum_at_nodes(self.plus.directions(plus))[~covered]
        values /= weight[:, None]
        tangent /= np.hypot(*tangent.T)[:, None]
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        return MortarPairing(Coupling(first, values, len(minus)), weight, normal, covered)

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


def _pointer(array: Floats | Integers) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return address(array)
