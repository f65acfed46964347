"""Lagrange polynomials on Gauss-Lobatto-Legendre points, in one dimension: sides of elements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Basis:
    """Lagrange polynomials on the Gauss-Lobatto-Legendre points of [-1, 1].

    Attributes
    ----------
    points, weights : ndarray, shape (order + 1,)
        Points and weights of the quadrature.
    inverse : ndarray, shape (order + 1, order + 1)
        From values at the points to coefficients of Legendre polynomials.
    """

    points: Floats
    weights: Floats
    inverse: Floats

    @classmethod
    def of_order(cls, order: int) -> Basis:
        """Return the basis of an order."""
        last = legendre.Legendre.basis(order)
        points = np.concatenate([[-1.0], np.sort(last.deriv().roots().real), [1.0]])
        points = 0.5 * (points - points[::-1])  # symmetric to the last digit
        weights = 2 / (order * (order + 1) * last(points) ** 2)
        return cls(points, weights, np.linalg.inv(legendre.legvander(points, order)))

    @property
    def order(self) -> int:
        return len(self.points) - 1

    def values(self, at: Floats) -> Floats:
        """Return the values of the polynomials at some positions, shape (..., order + 1)."""
        return legendre.legvander(at, self.order) @ self.inverse

    def slopes(self, at: Floats) -> Floats:
        """Return the derivatives at some positions, shape (..., order + 1)."""
        derivative = legendre.legder(self.inverse)  # of every column
        return legendre.legvander(at, self.order - 1) @ derivative


basis_of_order = cache(Basis.of_order)


def nodes_between(ends: Floats, order: int) -> Floats:
    """Return the ends of elements together with their inner nodes.

    Parameters
    ----------
    ends : ndarray, shape (elements + 1,)
    """
    part = 0.5 * (basis_of_order(order).points[:-1] + 1)
    return np.append((ends[:-1, None] + np.diff(ends)[:, None] * part).ravel(), ends[-1])
