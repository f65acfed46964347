"""Who faces whom written with arrays: what the compiled search and quadrature are compared to.

The dual basis itself is that of the product; its identities are tested without a reference.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ruptfx.bodies.meshes.lobatto import Basis
from ruptfx.interfaces.sliding.coupling import OVERHANG, REACH, SLIVER, Coupling, MortarPairing
from ruptfx.interfaces.sliding.mortar import LineMortar, dual_basis
from ruptfx.interfaces.sliding.surface import Floats, Integers, Surface


class MortarReference(LineMortar):
    """The coupling of two surfaces."""

    def __init__(self, plus: Surface, minus: Surface) -> None:
        super().__init__(plus, minus)
        self._dual = dual_basis(plus, *self._gauss)

    def _metric(self, facet: Integers, at: Floats) -> Floats:
        """ds / dxi of facets of the plus side where nothing has moved, at places of shape (facets, ...)."""
        corners = self.plus.points[self.plus.numbers][facet]
        found: Floats = np.linalg.norm(np.einsum("f...b,fbc->f...c", self.plus.basis.slopes(at), corners), axis=-1)
        return found

    def find(self, plus: Floats, minus: Floats) -> MortarPairing:
        """Who faces whom where the nodes are at these places.

        Parameters
        ----------
        plus, minus : ndarray, shapes (n, 2) and (facing nodes, 2)
            Of both surfaces, in the order of their chains [m].
        """
        order, other = self.plus.order, self.minus.order
        corners, facing = plus[self.plus.numbers], minus[self.minus.numbers]
        chord = corners[:, -1] - corners[:, 0]
        length = np.linalg.norm(chord, axis=1)
        along = chord / length[:, None]
        own, faced, low, high = self._overlaps(corners, facing, along, length)
        share = np.bincount(own, high - low, len(corners)) / length
        whole = share > 1 - 1e-6
        # Distances along the chord, of the nodes of both facets of every piece.
        here = np.einsum("kac,kc->ka", corners[own] - corners[own, :1], along[own])
        there = np.einsum("kac,kc->ka", facing[faced] - corners[own, :1], along[own])
        pieces = whole[own]
        at, weights = self._dual_quadrature(own[pieces], here[pieces], low[pieces], high[pieces])
        ends = ~pieces
        nodes, shares = self._collocation(own[ends], here[ends], low[ends], high[ends])
        n, m = len(plus), len(minus)
        block = np.zeros((len(own), order + 1, other + 1))
        tangent = np.zeros((len(own), order + 1, 2))
        for chosen, places, given in ((pieces, at, weights), (ends, nodes, shares)):
            wanted = np.einsum("kga,ka->kg", self.plus.basis.values(places), here[chosen])
            targets = np.broadcast_to(there[chosen][:, None], (*wanted.shape, other + 1))
            guess = 2 * (wanted - targets[..., 0]) / (targets[..., -1] - targets[..., 0]) - 1
            eta = between(self.minus.basis, np.clip(guess, -1, 1), wanted, targets)
            block[chosen] = np.einsum("kga,kgj->kaj", given, self.minus.basis.values(eta))
            slope = np.einsum("kgj,kjc->kgc", self.minus.basis.slopes(eta), facing[faced[chosen]])
            slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
            tangent[chosen] = np.einsum("kga,kgc->kac", given, slope)
        rows, columns = self.plus.numbers[own], self.minus.numbers[faced]
        coupling = sparse.csr_matrix(
            (block.ravel(), (np.repeat(rows, other + 1), np.repeat(columns, order + 1, axis=0).ravel())), shape=(n, m)
        )
        weight = np.asarray(coupling.sum(axis=1)).ravel()
        turned, nodal = np.zeros((n, 2)), self.plus.measures
        np.add.at(turned, rows, tangent)
        covered = weight > SLIVER * nodal
        turned[~covered] = self.plus.sum_at_nodes(self.plus.directions(plus))[~covered]
        scale = sparse.diags(np.where(covered, 1 / np.where(covered, weight, 1.0), 0.0))
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        rows_of = Coupling(np.zeros(n, dtype=np.int64), (scale @ coupling).toarray(), m)
        normal = np.stack([-turned[:, 1], turned[:, 0]], axis=1)
        return MortarPairing(rows_of, np.where(covered, weight, nodal), normal, covered)

    def _overlaps(
        self, corners: Floats, facing: Floats, along: Floats, length: Floats
    ) -> tuple[Integers, Integers, Floats, Floats]:
        """Pairs of facets that face each other, and from where to where along the chord of the first one [m]."""
        size = np.linalg.norm(facing[:, -1] - facing[:, 0], axis=1)
        reach = REACH * max(length.max(initial=0.0), size.max(initial=0.0))
        near = cKDTree(0.5 * (facing[:, 0] + facing[:, -1])).query_ball_point(
            0.5 * (corners[:, 0] + corners[:, -1]), reach, return_sorted=True
        )
        own = np.repeat(np.arange(len(corners)), [len(each) for each in near])
        faced = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
        begin, end = (np.einsum("kc,kc->k", facing[faced, i] - corners[own, 0], along[own]) for i in (0, -1))
        begin = begin - OVERHANG * size[faced] * (faced == 0)
        end = end + OVERHANG * size[faced] * (faced == len(size) - 1)
        low, high = np.maximum(begin, 0.0), np.minimum(end, length[own])
        kept = high - low > SLIVER * length[own]
        return own[kept], faced[kept], low[kept], high[kept]

    def _dual_quadrature(self, own: Integers, here: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Places on the facets and integration weights times the dual basis, shapes (k, g) and (k, g, nodes)."""
        basis = self.plus.basis
        first, last = (between(basis, 2 * s / here[:, -1] - 1, s, here) for s in (low, high))
        points, weights = self._gauss
        at = 0.5 * ((first + last)[:, None] + (last - first)[:, None] * points)
        measure = 0.5 * (last - first)[:, None] * weights * self._metric(own, at)
        return at, np.einsum("kg,kgb,kab->kga", measure, basis.values(at), self._dual[own])

    def _collocation(self, own: Integers, here: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """The nodes of facets that are partly covered, and what each piece counts of them."""
        slack = SLIVER * here[:, -1:]
        inside = (here > low[:, None] - slack) & (here < high[:, None] + slack)
        times = np.zeros((self.plus.facets, self.plus.order + 1))
        np.add.at(times, own, inside)  # a node above a facing vertex belongs to two pieces
        counted = np.where(inside, self._nodal[own] / np.maximum(times[own], 1), 0.0)
        places = np.broadcast_to(self.plus.basis.points, here.shape)
        return places, counted[:, :, None] * np.eye(self.plus.order + 1)


def between(basis: Basis, at: Floats, wanted: Floats, values: Floats) -> Floats:
    """Where polynomials that grow along [-1, 1] have wanted values, by Newton's method from `at`.

    Parameters
    ----------
    basis : Basis
    at, wanted : ndarray, shape (...)
    values : ndarray, shape (..., order + 1)
        Of the polynomials at the points.
    """
    if basis.order == 1:
        found: Floats = (2 * wanted - values[..., 0] - values[..., 1]) / (values[..., 1] - values[..., 0])
        return found
    for _ in range(30):
        reached = np.einsum("...a,...a->...", basis.values(at), values)
        slope = np.einsum("...a,...a->...", basis.slopes(at), values)
        step = (wanted - reached) / slope
        at = np.clip(at + step, -1.2, 1.2)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return at
