"""Mortar pairing of two surfaces of quadrilaterals in space, whose meshes need not match.

As on chains (`ruptfx.interfaces.sliding.mortar`), with these differences. A facet of order p is divided by its
Gauss-Lobatto nodes into p x p bilinear cells. Cells of the minus side are projected on the mean plane of a facet of the
plus side, that of its corners, and cut by its cells; the functions of order p of both facets are integrated over the
polygons, at points of the facets of order p themselves: extruded chains are paired as in the plane, also bent ones.

    psi_a = D_a sum_b (M^-1)_ab l_b,   M_ab = int l_a l_b dA,   D_a = int l_a dA

has M from the same points of quadrature as w B, so that constants, linear fields on plane facets and matching nodes
pass to round-off whatever the shape of the facets is. D is an integral over the undeformed facet, which no pairing
changes, with the metric interpolated between the nodes. On parallelograms the forces on both sides are the consistent
loads.

`mortar_surfaces.c` contains the code; the tests have a NumPy version.

Source: Puso and Laursen (2004) for segments, Popp et al. (2010) and Cichosz and Bischoff (2011) for dual functions in
space; here on GLL nodes, with frames of the minus side.
"""

from __future__ import annotations

import ctypes
from importlib.resources import files

import numpy as np
from numpy.polynomial import legendre

from ruptfx import RuptfxError
from ruptfx.interfaces.sliding.coupling import OVERHANG, REACH, SLIVER, Coupling, MortarPairing, whole
from ruptfx.interfaces.sliding.surface import Floats, Integers, Surface, corners_of, open_sides
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

LEAF = 4  # facets of the minus side in one leaf of the tree
COVERED_TWICE = -1  # result of `couple` in mortar_surfaces.c, whose other one is for folded facets


class Side(ctypes.Structure):
    """`struct side` of mortar_surfaces.c."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("x", "numbers", "inverse", "nodes")]


class Work(ctypes.Structure):
    """`struct work` of mortar_surfaces.c."""

    _fields_ = [
        ("plus", Side), ("minus", Side), ("facets", ctypes.c_long), ("others", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in (
            "sorted", "open", "metric", "integral", "lumped", "gauss", "gauss_weight",
        )),
        ("reach", ctypes.c_double), ("cells", ctypes.c_void_p), ("ball", ctypes.c_void_p), ("pairs", ctypes.c_void_p),
        ("pair_capacity", ctypes.c_long), ("blocks", ctypes.c_void_p), ("block_capacity", ctypes.c_long),
        *((name, ctypes.c_void_p) for name in ("opposite", "upto", "weight", "normal")),
        ("needed", ctypes.c_long * 3),
    ]  # fmt: skip


def points_per_direction(plus: int, minus: int) -> int:
    """Return the points of quadrature along a direction: exact for l and N on parallelograms, and for l N of order 1.

    The Jacobian of a triangle, of which two corners of a square are one, adds a degree. Facets of a higher order strain
    unevenly, and N is then no polynomial in the coordinates of the plus side: another point reduces the difference of a
    bent extruded chain and its plane from 1e-8 of the pressure to 1e-12.
    """
    highest = max(plus, minus)
    return 3 if highest == 1 else highest + 2


def integrals(surface: Surface) -> Floats:
    """Return the integrals of the shape functions over undeformed facets, shape (facets, nodes) [m^2]."""
    at, weights = legendre.leggauss(surface.order + 1)
    table = surface.basis.values(at)
    mass = (table.T * weights) @ table
    result: Floats = surface.metric @ np.kron(mass, mass)
    return result


class SurfaceMortar:
    """The mortar coupling of two surfaces.

    Raises
    ------
    RuptfxError
        Surfaces that do not face each other before anything moves.
    """

    def __init__(self, plus: Surface, minus: Surface) -> None:
        self.plus, self.minus = plus, minus
        self._gauss = legendre.leggauss(points_per_direction(plus.order, minus.order))
        self._metric, self._integral, self._lumped = plus.metric, integrals(plus), plus.shares
        self._measures = plus.measures
        corners = corners_of(minus.numbers, minus.order)
        self._open = open_sides(minus.numbers, minus.order).astype(np.uint8)
        self._sorted = halved(minus.points[corners].mean(axis=1), np.arange(minus.facets))
        self._around = np.argsort(plus.numbers.ravel(), kind="stable")
        count = np.bincount(plus.numbers.ravel(), minlength=len(plus.points))
        self._begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
        self._sides = [(corners_of(side.numbers, side.order), side) for side in (plus, minus)]
        macros = {
            "PLUS": plus.order, "MINUS": minus.order, "LINE": len(self._gauss[0]), "LEAF": LEAF, "OVERHANG": OVERHANG,
            "SLIVER": SLIVER,
        }  # fmt: skip
        source = files("ruptfx.interfaces.sliding").joinpath("mortar_surfaces.c").read_text()
        self._library = native.load("mortar_surfaces", source, macros)
        for name in ("couple", "rows", "size_of_pair", "size_of_cell"):
            getattr(self._library, name).restype = ctypes.c_long
        self._opposite = np.zeros(0, dtype=np.int64)
        self._upto = np.zeros(plus.facets + 1, dtype=np.int64)
        self._cells = np.zeros(minus.facets * minus.order**2 * self._library.size_of_cell(), dtype=np.uint8)
        self._ball = np.zeros((4 * minus.facets + 4, 4))
        self._grow(64 * plus.order**2, 8 * plus.facets)
        if plus.facets and minus.facets:
            self._require_facing()

    def find(self, plus: Floats, minus: Floats) -> MortarPairing:
        """Return the pairing for given coordinates of the nodes.

        Parameters
        ----------
        plus, minus : ndarray, shapes (n, 3) and (nodes of the minus side, 3)
            Coordinates of both surfaces [m].

        Raises
        ------
        RuptfxError
            A facet that faces two parts of the other surface, or a folded one.
        """
        plus, minus = np.ascontiguousarray(plus), np.ascontiguousarray(minus)
        longest = max(
            np.linalg.norm(np.diff(x[corners], axis=1), axis=2).max(initial=0.0)
            for x, (corners, _) in zip((plus, minus), self._sides, strict=True)
        )
        weight, normal = np.zeros(len(plus)), np.zeros_like(plus)
        work, failure = self._couple(plus, minus, REACH * float(longest), weight, normal)
        if failure:
            x, y, z = plus[self.plus.numbers[work.needed[2]]].mean(axis=0)
            raise RuptfxError(
                f"the interface faces two parts of the other surface at ({x:.6g}, {y:.6g}, {z:.6g}) m: it must not "
                "fold back within ten elements of an interface that slides"
                if failure == COVERED_TWICE else
                f"the surface at ({x:.6g}, {y:.6g}, {z:.6g}) m, or the opposite one, is folded or bent too much: its "
                "pairing does not exist; use a smoother surface, or smaller elements"
            )  # fmt: skip
        columns, values = self._rows(work, len(plus), len(minus))
        covered = weight > SLIVER * self._measures
        if not covered.all():
            values[~covered], weight[~covered] = 0.0, self._measures[~covered]
            normal[~covered] = self.plus.sum_at_nodes(self.plus.directions(plus))[~covered]
        values /= weight[:, None]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return MortarPairing(
            Coupling(columns[:, 0].copy(), values, len(minus), listed=columns), weight, normal, covered
        )

    def _grow(self, pairs: int, blocks: int) -> None:
        """Allocate arrays for the pairs of one facet, and for the blocks of all."""
        self._capacity = pairs, blocks
        self._pairs = np.zeros(pairs * self._library.size_of_pair(), dtype=np.uint8)
        self._blocks = np.empty((blocks, self.plus.numbers.shape[1], self.minus.numbers.shape[1]))
        self._opposite = np.zeros(blocks, dtype=np.int64)

    def _couple(self, plus: Floats, minus: Floats, reach: float, weight: Floats, normal: Floats) -> tuple[Work, int]:
        """Set blocks, weights and normals, and return the arguments and the failure, 0 without."""
        sides = [
            Side(address(x), address(side.numbers), address(side.basis.inverse), address(side.basis.points))
            for x, side in ((plus, self.plus), (minus, self.minus))
        ]
        fixed: list[Floats] = [self._metric, self._integral, self._lumped, *self._gauss]
        while True:
            weight[:], normal[:] = 0.0, 0.0
            work = Work(
                *sides, self.plus.facets, self.minus.facets,
                address(self._sorted), address(self._open), *map(address, fixed),
                reach, address(self._cells), address(self._ball), address(self._pairs), self._capacity[0],
                address(self._blocks), self._capacity[1],
                *map(address, (self._opposite, self._upto, weight, normal)),
            )  # fmt: skip
            failure: int = self._library.couple(ctypes.byref(work))
            pairs, blocks, _ = work.needed
            if failure or (pairs <= self._capacity[0] and blocks <= self._capacity[1]):
                return work, failure
            self._grow(max(2 * pairs, self._capacity[0]), max(blocks + blocks // 4, self._capacity[1]))

    def _rows(self, work: Work, n: int, m: int) -> tuple[Integers, Floats]:
        """Return nodes and values of w B, shapes (n, width)."""
        used = np.empty((2, m), dtype=np.int64)

        def rows(width: int, *table: ctypes.c_void_p) -> int:
            points = ctypes.c_long(n), address(self._begin), address(self._around), address(used[0]), address(used[1])
            longest: int = self._library.rows(
                ctypes.byref(work), *points, ctypes.c_long(m), ctypes.c_long(width), *table
            )
            return longest

        width = whole(max(rows(0, address(None), address(None)), 1))
        columns, values = np.empty((n, width), dtype=np.int64), np.zeros((n, width))
        rows(width, address(columns), address(values))
        return columns, values

    def _require_facing(self) -> None:
        plus, minus = np.ascontiguousarray(self.plus.points), np.ascontiguousarray(self.minus.points)
        weight = np.zeros(len(plus))
        _, failure = self._couple(plus, minus, np.inf, weight, np.zeros_like(plus))
        if failure or weight.any():
            return
        (x, y, z), (u, v, w) = (points.mean(axis=0) for points in (plus, minus))
        raise RuptfxError(
            f"the surfaces of an interface that slides do not face each other: no point of the plus side, around "
            f"({x:.6g}, {y:.6g}, {z:.6g}) m, lies opposite a point of the minus side, around "
            f"({u:.6g}, {v:.6g}, {w:.6g}) m; move a body, exchange both sides, or use smaller elements on the plus side"
        )


def halved(middles: Floats, facets: Integers) -> Integers:
    """Return facets in the order of a tree: ranges are halved along their longest direction down to LEAF facets."""
    if len(facets) <= LEAF:
        return facets
    along = middles[facets]
    facets = facets[np.argsort(along[:, np.argmax(np.ptp(along, axis=0))], kind="stable")]
    middle = len(facets) // 2
    return np.concatenate([halved(middles, facets[:middle]), halved(middles, facets[middle:])])
