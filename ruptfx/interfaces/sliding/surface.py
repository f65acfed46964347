"""One side of a sliding interface: facets between the nodes of one body, a chain in a plane and a surface in space."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.bodies.meshes.lobatto import Basis, basis_of_order

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SAME = 1e-9  # part of the extent: coordinates that differ by less are sorted as equal


@dataclass(frozen=True)
class Surface:
    """Facets of one side of an interface: an open chain in a plane, quadrilaterals in space.

    Facets of a chain run along the tangent of the interface, in the same direction on both sides; facet e has the nodes
    e * order to (e + 1) * order. Normals of quadrilaterals, the cross products of the derivatives along the first and
    the second reference coordinate, point out of the minus body and into the plus body on both sides.

    Attributes
    ----------
    nodes : ndarray of int, shape (n,)
        Local nodes of the displacement space, in order along the chain; empty on ranks without the surface, and
        where the surface is rigid.
    points : ndarray, shape (n, dim)
        Undeformed coordinates [m], bitwise the same on all ranks.
    order : int
    numbers : ndarray of int, shape (facets, (order + 1) ** (dim - 1))
        Indices of the nodes of every facet among the points, along the second reference coordinate fastest.
    """

    nodes: Integers
    points: Floats
    order: int
    of_facets: InitVar[Integers | None] = None
    numbers: Integers = field(init=False)

    def __post_init__(self, of_facets: Integers | None) -> None:
        if of_facets is None:
            chain = np.arange(max(0, len(self.points) - 1) // self.order)
            of_facets = chain[:, None] * self.order + np.arange(self.order + 1)
        object.__setattr__(self, "numbers", np.ascontiguousarray(of_facets, dtype=np.int64))

    @property
    def basis(self) -> Basis:
        return basis_of_order(self.order)

    @property
    def facets(self) -> int:
        return len(self.numbers)

    @property
    def metric(self) -> Floats:
        """Length or area per reference length or area at the nodes of every facet, shape of `numbers`."""
        size: Floats = np.linalg.norm(self.directions(self.points), axis=2)
        return size

    @property
    def shares(self) -> Floats:
        """Length or area of the nodes of every facet, shape of `numbers` [m or m^2]."""
        weights = self.basis.weights
        return self.metric * (weights if self.points.shape[1] == 2 else np.outer(weights, weights).ravel())

    @property
    def measures(self) -> Floats:
        """Length or area of every node [m or m^2]."""
        return np.bincount(self.numbers.ravel(), self.shares.ravel(), len(self.points))

    @property
    def spacing(self) -> float:
        """Median distance of neighbouring nodes [m]."""
        return float(np.median(np.concatenate([np.linalg.norm(step, axis=-1).ravel() for step in self._steps()])))

    def directions(self, points: Floats) -> Floats:
        """Return the tangent of a chain or the normal of a surface at the nodes of its facets, not normalised.

        Parameters
        ----------
        points : ndarray, shape (n, dim)
            Coordinates of the nodes [m].

        Returns
        -------
        ndarray, shape (facets, nodes of a facet, dim)
        """
        slopes, corners = self.basis.slopes(self.basis.points), points[self.numbers]
        if points.shape[1] == 2:
            tangents: Floats = np.einsum("gb,fbc->fgc", slopes, corners)
            return tangents
        lattice = corners.reshape(self.facets, self.order + 1, self.order + 1, 3)
        along = [np.einsum(product, slopes, lattice) for product in ("ga,fabc->fgbc", "gb,fabc->fagc")]
        return np.cross(*along).reshape(corners.shape)

    def sum_at_nodes(self, values: Floats) -> Floats:
        """Return the sums over facets of vectors at their nodes, shape (n, dim)."""
        result = np.zeros((len(self.points), values.shape[2]))
        np.add.at(result, self.numbers, values)
        return result

    def _steps(self) -> list[Floats]:
        """Return vectors between neighbouring nodes."""
        if self.points.shape[1] == 2:
            return [np.diff(self.points, axis=0)]
        lattice = self.points[self.numbers].reshape(self.facets, self.order + 1, self.order + 1, 3)
        return [np.diff(lattice, axis=axis) for axis in (1, 2)]


def corners_of(numbers: Integers, order: int) -> Integers:
    """Return the corners of quadrilaterals in turn, shape (facets, 4)."""
    return numbers[:, [0, order * (order + 1), (order + 1) ** 2 - 1, order]]


def open_sides(numbers: Integers, order: int) -> NDArray[np.bool_]:
    """Return the sides of quadrilaterals without a neighbour, from corner to corner in turn; shape (facets, 4)."""
    _, index, count = np.unique(_sides(numbers, order), axis=0, return_inverse=True, return_counts=True)
    result: NDArray[np.bool_] = count[index.reshape(-1, 4)] == 1
    return result


def lattice_numbers(shape: tuple[int, int], order: int) -> Integers:
    """Return the nodes of the facets of a lattice, whose points are numbered along its second direction fastest.

    Parameters
    ----------
    shape : tuple of int
        Facets along both directions.

    Returns
    -------
    ndarray of int, shape (facets, (order + 1) ** 2)
    """
    rows, columns = (np.arange(many)[:, None] * order + np.arange(order + 1) for many in shape)
    numbers = rows[:, None, :, None] * (shape[1] * order + 1) + columns[None, :, None, :]
    return numbers.reshape(-1, (order + 1) ** 2).astype(np.int64)


def surface_of_facets(
    facets: Integers, coordinates: Floats, inside: Floats, *, order: int, inward: bool, name: str
) -> Surface:
    """Return quadrilaterals as a surface, with nodes and facets in an order that no partition changes.

    Parameters
    ----------
    facets : ndarray of int, shape (m, (order + 1) ** 2)
        Local nodes of every facet, tensor product with the second direction fastest; facets may be listed twice.
    coordinates : ndarray, shape (local nodes, 3)
        Undeformed coordinates [m].
    inside : ndarray, shape (m, 3)
        A point of the body beside every facet, as the middle of its cell [m].
    inward : bool
        Whether normals point into the body: those of the plus side.
    name : str
        Side, for messages.

    Raises
    ------
    RuptfxError
        Facets that are a closed surface, or no surface: more than two share a side, or the body changes sides.
    """
    if not len(facets):
        return Surface(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), order, np.zeros((0, (order + 1) ** 2), np.int64))
    _, single = np.unique(np.sort(facets, axis=1), axis=0, return_index=True)
    facets, inside = facets[single], inside[single]
    nodes = np.unique(facets)
    points = coordinates[nodes]
    nodes = nodes[np.lexsort(np.round(points.T[::-1] / (SAME * np.ptp(points, axis=0).max())))]
    place = np.zeros(len(coordinates), dtype=np.int64)
    place[nodes] = np.arange(len(nodes))
    numbers, points = place[facets], coordinates[nodes]
    around = points[corners_of(numbers, order)]
    normal = np.cross(around[:, 2] - around[:, 0], around[:, 3] - around[:, 1])
    turned = (np.sum(normal * (inside - around.mean(axis=1)), axis=1) > 0) != inward
    lattice = numbers.reshape(-1, order + 1, order + 1)
    numbers = np.where(turned[:, None, None], lattice.transpose(0, 2, 1), lattice).reshape(numbers.shape)
    numbers = numbers[np.lexsort(corners_of(numbers, order).T[::-1])]
    _require_manifold(numbers, points, order, name)
    return Surface(nodes, points, order, numbers)


def _sides(numbers: Integers, order: int, directed: bool = False) -> Integers:
    """Return the corners of all sides, shape (4 * facets, 2), the smaller first unless directed."""
    corners = corners_of(numbers, order)
    sides: Integers = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    return sides if directed else np.sort(sides, axis=1)


def _require_manifold(numbers: Integers, points: Floats, order: int, name: str) -> None:
    sides, count = np.unique(_sides(numbers, order), axis=0, return_counts=True)
    if not np.any(count == 1):
        raise RuptfxError(
            f"{name}: {len(numbers)} facets that are a closed surface; a surface that slides needs a rim: use the part "
            "of it that can touch the other body"
        )
    directed, same = np.unique(_sides(numbers, order, directed=True), axis=0, return_counts=True)
    for pairs, many in ((sides, count > 2), (directed, same > 1)):
        if many.any():
            x, y, z = points[pairs[np.argmax(many)]].mean(axis=0)
            raise RuptfxError(
                f"{name}: facets that are no surface: at ({x:.6g}, {y:.6g}, {z:.6g}) m more than two share a side, or "
                "their body changes sides there; use facets of one body that do not branch"
            )
