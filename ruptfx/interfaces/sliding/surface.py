"""One side of a sliding interface: a curve of facets between the nodes of one body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.meshes.lobatto import Basis, basis_of_order

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Surface:
    """An open chain of facets along the tangent of the interface, in the same direction on both sides.

    Facet e has the nodes e * order to (e + 1) * order.

    Attributes
    ----------
    nodes : ndarray of int, shape (facets * order + 1,)
        Local nodes of the displacement space, in order along the chain; empty on ranks without the chain, and
        where the surface is rigid.
    points : ndarray, shape (facets * order + 1, 2)
        Undeformed coordinates [m], bitwise the same on all ranks.
    order : int
    """

    nodes: Integers
    points: Floats
    order: int

    @property
    def basis(self) -> Basis:
        return basis_of_order(self.order)

    @property
    def facets(self) -> int:
        return max(0, len(self.points) - 1) // self.order

    @property
    def numbers(self) -> Integers:
        """Indices of the nodes of every facet in the chain, shape (facets, order + 1)."""
        return np.arange(self.facets)[:, None] * self.order + np.arange(self.order + 1)

    @property
    def shares(self) -> Floats:
        """Length of the nodes of every facet, shape (facets, order + 1) [m]."""
        slopes = np.einsum("gb,fbc->fgc", self.basis.slopes(self.basis.points), self.points[self.numbers])
        weights: Floats = self.basis.weights * np.linalg.norm(slopes, axis=2)
        return weights

    @property
    def lengths(self) -> Floats:
        """Length of every node [m]."""
        values = np.zeros(len(self.points))
        np.add.at(values, self.numbers, self.shares)
        return values

    @property
    def spacing(self) -> float:
        """Median distance of neighbouring nodes [m]."""
        return float(np.median(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))
