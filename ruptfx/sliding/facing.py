"""Who faces whom, and how tractions go over: a dual mortar on the nodes of the plus side, frozen between updates.

Traction lives at the nodes of the plus side, with the dual basis psi of their Lagrange basis l on every facet,

    psi_a = D_a sum_b (M^-1)_ab l_b,   M_ab = int l_a l_b ds,   D_a = int l_a ds,

so that w_i = sum of D_a is the length of a point and what it faces is the mean

    x-_i = sum_j B_ij x-_j,   w_i B_ij = int psi_i N_j ds,

with the basis N of the facing facets where the facet's points project on them, along the normal of its chord. Facets
are cut where facing vertices project on them, so that a uniform stress passes to round-off between any meshes. The
tangent of a point is the mean of the *facing* one with the same psi: then J = frame (u+ - B u-) is the gradient of the
gap where that is closed, sliding included, and a frozen operator does no work in sliding.

Where a facet reaches over the end of the facing surface its nodes are taken one by one: those that face something with
what is opposite to them; the others carry nothing.

`facing.c` does the work; the tests have the same with arrays.

Source: Wohlmuth (2000), Popp et al. (2009) for dual mortars; here on GLL nodes, with facing frames.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ruptfx import RuptfxError, native
from ruptfx.sliding.surface import Floats, Integers, Surface

REACH = 10  # facets of either side: what is farther away is not faced
OVERHANG = 0.02  # of a facet: the ends of two bodies one above the other are not beside each other because they tilt
SLIVER = 1e-9  # of a facet: what is shorter is not integrated
COLUMNS = 8  # rows of B are filled up to a multiple of this


def whole(columns: int) -> int:
    """The next multiple of `COLUMNS`."""
    return -(-columns // COLUMNS) * COLUMNS


@dataclass(frozen=True)
class Coupling:
    """B: what a point faces is a mean of nodes that follow each other on the other side.

    Attributes
    ----------
    first : ndarray of int, shape (n,)
        The first node of every row; 0 where nothing is faced.
    values : ndarray, shape (n, columns)
        Of the nodes from there on, zero beyond what is faced; the same number of columns in all rows.
    nodes : int
        Of the other side.
    """

    first: Integers
    values: Floats
    nodes: int

    def __matmul__(self, nodal: Floats) -> Floats:
        """B times values at the nodes of the other side, shape (nodes, ...)."""
        if not self.nodes:
            return np.zeros((len(self.first), *nodal.shape[1:]))
        columns = np.minimum(self.first[:, None] + np.arange(self.values.shape[1]), self.nodes - 1)
        found: Floats = np.einsum("ij,ij...->i...", self.values, nodal[columns])
        return found

    def squared(self) -> Coupling:
        """With the squares of all entries."""
        return Coupling(self.first, self.values**2, self.nodes)

    def transposed(self) -> Coupling:
        """B': the points that face every node of the other side, which follow each other, too."""
        point, column = np.nonzero(self.values)
        node = self.first[point] + column
        first, last = np.zeros((2, self.nodes), dtype=np.int64)
        first[node[::-1]], last[node] = point[::-1], point  # in order: the one that is written last counts
        values = np.zeros((self.nodes, whole(int(np.max(last - first, initial=0)) + 1)))
        values[node, point - first[node]] = self.values[point, column]
        return Coupling(first, values, len(self.first))

    def nearest(self) -> Integers:
        """The node that a point faces most."""
        return self.first + np.argmax(self.values, axis=1)


@dataclass(frozen=True)
class Facing:
    """Who faces whom at one time.

    Attributes
    ----------
    coupling : Coupling
        B; zero where nothing is faced.
    weight : ndarray, shape (n,)
        Length of every point [m]; where nothing is faced that of its nodes.
    tangent : ndarray, shape (n, 2)
        Of the facing surface, a unit vector.
    covered : ndarray of bool, shape (n,)
        Whether the point faces something.
    """

    coupling: Coupling
    weight: Floats
    tangent: Floats
    covered: NDArray[np.bool_]


def dual_basis(plus: Surface, at: Floats, weights: Floats) -> Floats:
    """Coefficients D_a (M^-1)_ab of psi_a in the Lagrange basis, by quadrature; shape (facets, nodes, nodes)."""
    table, corners = plus.basis.values(at), plus.points[plus.numbers]
    metric = np.linalg.norm(np.einsum("gb,fbc->fgc", plus.basis.slopes(at), corners), axis=2) * weights
    mass = np.einsum("fg,ga,gb->fab", metric, table, table)
    found: Floats = np.einsum("fg,ga->fa", metric, table)[:, :, None] * np.linalg.inv(mass)
    return found


class Mortar:
    """The coupling of two surfaces.

    Parameters
    ----------
    plus, minus : Surface
    """

    def __init__(self, plus: Surface, minus: Surface) -> None:
        self.plus, self.minus = plus, minus
        basis, corners = plus.basis, plus.points[plus.numbers]
        # The same points here and on what faces one facet alone: nodes that match then face each other exactly.
        self._gauss = at, weights = legendre.leggauss(plus.order + -(-minus.order // 2) + 2)
        # In Legendre polynomials: of the dual basis, and of the places of the nodes.
        self._dual = np.ascontiguousarray(dual_basis(plus, at, weights) @ basis.inverse.T)
        self._shape = np.ascontiguousarray(np.einsum("ka,fac->fck", basis.inverse, corners))
        self._nodal, self._length = plus.shares, plus.lengths
        macros = {
            "PLUS": plus.order, "MINUS": minus.order, "GAUSS": len(at), "REACH": REACH, "OVERHANG": OVERHANG,
            "SLIVER": SLIVER,
        }  # fmt: skip
        self._library = native.load("facing", files("ruptfx.sliding").joinpath("facing.c").read_text(), macros)
        self._library.overlaps.restype = self._library.couple.restype = ctypes.c_long
        self._groups = np.zeros(3 * minus.facets)
        self._grow(4 * (plus.facets + minus.facets))

    def _grow(self, capacity: int) -> None:
        """Room for pieces: facets and from where to where they overlap."""
        self._pair, self._ends = np.zeros((2, capacity), dtype=np.int64), np.zeros((2, capacity))

    def find(self, plus: Floats, minus: Floats) -> Facing:
        """Who faces whom where the nodes are at these places.

        Parameters
        ----------
        plus, minus : ndarray, shapes (n, 2) and (facing nodes, 2)
            Of both surfaces, in the order of their chains [m].

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
        return Facing(Coupling(first, values, len(minus)), weight, tangent, covered)

    def _overlaps(self, plus: Floats, minus: Floats) -> tuple[int, Floats]:
        """How many pieces there are, and how much of every facet is faced."""
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
        """The first column of every row, and the columns of the longest one."""
        facets, order = self.plus.facets, self.plus.order
        begin, end = np.full(facets, len(self.minus.nodes)), np.zeros(facets, dtype=np.int64)
        own, faced = self._pair[:, :pieces]
        np.minimum.at(begin, own, faced * self.minus.order)
        np.maximum.at(end, own, (faced + 1) * self.minus.order + 1)
        of_node = np.repeat(begin, order), np.repeat(end, order)
        first, last = np.append(of_node[0], begin[-1]), np.append(of_node[1], end[-1])
        inner = np.arange(1, facets) * order  # nodes of two facets
        first[inner], last[inner] = np.minimum(begin[1:], begin[:-1]), np.maximum(end[1:], end[:-1])
        columns = int(np.max(last - first, initial=1))
        return np.where(last > 0, first, 0), whole(columns)

    def _own_tangent(self, plus: Floats) -> Floats:
        """Mean tangent of the plus side at its nodes, not normalised."""
        slopes = np.einsum("gb,fbc->fgc", self.plus.basis.slopes(self.plus.basis.points), plus[self.plus.numbers])
        tangent = np.zeros_like(plus)
        np.add.at(tangent, self.plus.numbers, slopes)
        return tangent


def _pointer(array: Floats | Integers) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)
