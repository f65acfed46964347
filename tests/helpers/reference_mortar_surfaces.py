"""The mortar pairing of two surfaces with arrays and without a tree, a reference for the compiled one."""

from __future__ import annotations

from itertools import product

import numpy as np

from ruptfx.bodies.meshes.lobatto import Basis
from ruptfx.interfaces.sliding.coupling import OVERHANG, REACH, SLIVER, Coupling, MortarPairing
from ruptfx.interfaces.sliding.mortar_surfaces import SurfaceMortar, integrals
from ruptfx.interfaces.sliding.surface import Floats, Integers, corners_of, open_sides

# Cells of both sides, facet of the minus side; corners of both cells and nodes of both facets in the plane; overlap.
Pairs = list[tuple[tuple[int, int], int, tuple[int, int], Floats, Floats, Floats, Floats, Floats]]

ENDS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


class SurfaceMortarReference(SurfaceMortar):
    """The coupling of two surfaces."""

    def find(self, plus: Floats, minus: Floats) -> MortarPairing:
        """Return the pairing for given coordinates of the nodes, shapes (n, 3) and (nodes of the minus side, 3)."""
        order, other = self.plus.order, self.minus.order
        sizes = [np.linalg.norm(np.diff(x[corners_of(side.numbers, side.order)], axis=1), axis=2).max()
                 for x, side in ((plus, self.plus), (minus, self.minus))]  # fmt: skip
        reach, n, m = REACH * max(sizes), len(plus), len(minus)
        cells = [
            (f, i, j, minus[numbers.reshape(other + 1, -1)[[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]]])
            for (f, numbers), i, j in product(enumerate(self.minus.numbers), range(other), range(other))
        ]
        coupling, weight, normal = np.zeros((n, m)), np.zeros(n), np.zeros((n, 3))
        for e, numbers in enumerate(self.plus.numbers):
            pairs: Pairs = []
            whole = True
            outline = plus[corners_of(self.plus.numbers, order)[e]]
            axes, origin = plane(outline), outline.mean(axis=0)
            own_nodes = (plus[numbers] - origin) @ axes[:2].T
            for i, j in product(range(order), range(order)):
                own = plus[numbers.reshape(order + 1, -1)[[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]]]
                covered, own_flat = 0.0, (own - origin) @ axes[:2].T
                area = area_of(own_flat)
                for f, k, l, corners in cells:  # noqa: E741
                    if abs((corners.mean(axis=0) - own.mean(axis=0)) @ axes[2]) > reach + np.linalg.norm(
                        np.ptp(corners)
                    ):
                        continue
                    flat = (corners - origin) @ axes[:2].T
                    ranges = [
                        (each.min(axis=0), each.max(axis=0)) for each in (self._extended(flat, f, k, l), own_flat)
                    ]
                    if np.any(ranges[0][0] > ranges[1][1]) or np.any(ranges[1][0] > ranges[0][1]):
                        continue
                    polygon = (
                        cut(self._extended(flat, f, k, l), own_flat) if area_of(flat) > SLIVER * area else flat[:0]
                    )
                    covered += area_of(polygon)
                    nodes = (minus[self.minus.numbers[f]] - origin) @ axes[:2].T
                    pairs.append(((i, j), f, (k, l), own_flat, flat, own_nodes, nodes, polygon))
                whole = whole and bool(covered > (1 - 1e-6) * area)
            block, turned, share = (self._dual if whole else self._collocated)(e, minus, pairs)
            np.add.at(coupling, numbers, block)
            np.add.at(normal, numbers, turned)
            np.add.at(weight, numbers, share)
        covered_points = weight > SLIVER * self.plus.measures
        normal[~covered_points] = self.plus.sum_at_nodes(self.plus.directions(plus))[~covered_points]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        weight = np.where(covered_points, weight, self.plus.measures)
        columns = np.tile(np.arange(m), (n, 1))
        return MortarPairing(
            Coupling(columns[:, 0], coupling / weight[:, None], m, columns), weight, normal, covered_points
        )

    def _limits(self, f: int, k: int, l: int) -> tuple[Floats, Floats]:  # noqa: E741
        """Return the range of the reference coordinates of a cell of the minus side with its overhang."""
        nodes, last = self.minus.basis.points, self.minus.order - 1
        opened = open_sides(self.minus.numbers, self.minus.order)[f]
        more = 4 * OVERHANG / np.diff(nodes)[[k, l]]
        low = -1 - more * np.array([k == 0 and opened[3], l == 0 and opened[0]])
        return low, 1 + more * np.array([k == last and opened[1], l == last and opened[2]])

    def _extended(self, flat: Floats, f: int, k: int, l: int) -> Floats:  # noqa: E741
        low, high = self._limits(f, k, l)
        return bilinear(flat, np.where(ENDS < 0, low, high))

    def _across(self, minus: Floats, f: int, at: Floats) -> tuple[Floats, Floats]:
        """Return the basis and the unit normal of a facet at points, shape (g, 2)."""
        table, along_s, along_t = shapes(self.minus.basis, at)
        corners = minus[self.minus.numbers[f]]
        normal = np.cross(along_s @ corners, along_t @ corners)
        return table, normal / np.linalg.norm(normal, axis=1)[:, None]

    def _dual(self, e: int, minus: Floats, pairs: Pairs) -> tuple[Floats, Floats, Floats]:
        basis, order = self.plus.basis, self.plus.order
        mass = np.zeros(((order + 1) ** 2,) * 2)
        block, turned = np.zeros((len(mass), len(minus))), np.zeros((len(mass), 3))
        for cell, f, other, own, flat, own_nodes, nodes, polygon in pairs:
            corners = without_flat_corners(polygon, area_of(own))
            reference = in_facet(basis, own_nodes, cell, inverse(own, corners)[0], corners)
            for at, w in parts(reference, *self._gauss):
                table = shapes(basis, at)[0]
                measure = w * (table @ self._metric[e])
                x = table @ own_nodes
                there = in_facet(self.minus.basis, nodes, other, inverse(flat, x)[0], x)
                values, normal = self._across(minus, f, there)
                mass += table.T @ (measure[:, None] * table)
                block[:, self.minus.numbers[f]] += table.T @ (measure[:, None] * values)
                turned += table.T @ (measure[:, None] * normal)
        share = integrals(self.plus)[e]
        dual = share[:, None] * np.linalg.inv(mass)
        return dual @ block, dual @ turned, share

    def _collocated(self, e: int, minus: Floats, pairs: Pairs) -> tuple[Floats, Floats, Floats]:
        order = self.plus.order
        block, turned = np.zeros(((order + 1) ** 2, len(minus))), np.zeros(((order + 1) ** 2, 3))
        times = np.zeros(len(block))
        for (i, j), f, other, own, flat, _, nodes, _ in pairs:
            low, high = self._limits(f, *other)
            at, det = inverse(flat, own)
            corners = [(i + a) * (order + 1) + j + b for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            inside = np.all((at > low - SLIVER) & (at < high + SLIVER), axis=1) & (det > SLIVER * area_of(own))
            there = in_facet(self.minus.basis, nodes, other, at[inside], own[inside])
            values, normal = self._across(minus, f, there)
            for corner, value, direction in zip(np.array(corners)[inside], values, normal, strict=True):
                block[corner, self.minus.numbers[f]] += value
                turned[corner] += direction
                times[corner] += 1
        share = np.where(times > 0, self._lumped[e], 0.0)
        scale = (share / np.maximum(times, 1))[:, None]
        return scale * block, scale * turned, share


def plane(corners: Floats) -> Floats:
    """Return two axes in the mean plane of four corners, and its normal."""
    first, second = corners[2] - corners[0], corners[3] - corners[1]
    normal, along = np.cross(first, second), first - second
    normal, along = normal / np.linalg.norm(normal), along / np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal])


def shapes(basis: Basis, at: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the functions of a facet and their derivatives along both directions at points, shapes (g, nodes)."""
    tables = [(basis.values(x), basis.slopes(x)) for x in at.T]
    (s, by_s), (t, by_t) = tables
    size = len(at), len(basis.points) ** 2
    first, second, third = (np.einsum("gi,gj->gij", *each).reshape(size) for each in ((s, t), (by_s, t), (s, by_t)))
    return first, second, third


def in_facet(basis: Basis, nodes: Floats, cell: tuple[int, int], at: Floats, x: Floats) -> Floats:
    """Return reference coordinates on a facet of points x, by Newton's method from those of its bilinear cell."""
    low, high = (basis.points[np.array(cell) + k] for k in (0, 1))
    at = 0.5 * (low + high + at * (high - low))
    for _ in range(30):
        table, along_s, along_t = shapes(basis, at)
        matrix = np.stack([along_s @ nodes, along_t @ nodes], axis=2)
        at = at + np.linalg.solve(matrix, (x - table @ nodes)[..., None])[..., 0]
    return at


def bilinear(corners: Floats, at: Floats) -> Floats:
    x: Floats = 0.25 * np.prod(1 + at[:, None] * ENDS, axis=2) @ corners
    return x


def jacobian(corners: Floats, at: Floats) -> Floats:
    """Return derivatives along both reference coordinates, shape (g, 2, 2)."""
    slopes = 0.25 * ENDS * (1 + at[:, None] * ENDS)[:, :, ::-1]
    result: Floats = np.einsum("gka,kc->gac", slopes, corners)
    return result


def inverse(corners: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return reference coordinates of points, by Newton's method, and the Jacobian there."""
    at = np.zeros_like(x)
    for _ in range(30):
        at = (
            at
            + np.linalg.solve(jacobian(corners, at).transpose(0, 2, 1), (x - bilinear(corners, at))[..., None])[..., 0]
        )
    return at, np.linalg.det(jacobian(corners, at))


def area_of(polygon: Floats) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def cut(polygon: Floats, clip: Floats) -> Floats:
    """Return the part of a polygon inside a convex one."""
    for a, b in zip(clip, np.roll(clip, -1, axis=0), strict=True):
        side = (b[0] - a[0]) * (polygon[:, 1] - a[1]) - (b[1] - a[1]) * (polygon[:, 0] - a[0])
        kept: list[Floats] = []
        for i, of_now in enumerate(side):
            now, k = polygon[i], (i + 1) % len(polygon)
            kept += [now] * bool(of_now >= 0)
            if of_now * side[k] < 0:
                kept.append(now + of_now / (of_now - side[k]) * (polygon[k] - now))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def without_flat_corners(polygon: Floats, area: float) -> Floats:
    """Return a polygon without corners on the line between their neighbours; none for a sliver."""
    if area_of(polygon) <= SLIVER * area:
        return polygon[:0]
    i = 0
    while i < len(polygon):
        before, now, after = polygon[i - 1], polygon[i], polygon[(i + 1) % len(polygon)]
        if abs(2 * area_of(np.array([before, now, after]))) > 1e-12 * area:
            i += 1
        else:
            polygon, i = np.delete(polygon, i, axis=0), max(i - 1, 0)
    return polygon


def parts(polygon: Floats, points: Floats, weights: Floats) -> list[tuple[Floats, Floats]]:
    """Return points and weights of a quadrilateral, or of the triangles of a fan."""
    pieces: list[Integers] = [np.arange(4)] if len(polygon) == 4 else [
        np.array([0, 0, k, k + 1]) for k in range(1, len(polygon) - 1)
    ]  # fmt: skip
    at = np.stack(np.meshgrid(points, points, indexing="ij"), axis=-1).reshape(-1, 2)
    w = np.outer(weights, weights).ravel()
    return [(bilinear(polygon[k], at), w * np.linalg.det(jacobian(polygon[k], at))) for k in pieces]


def dense(coupling: Coupling) -> Floats:
    """Return B as a matrix."""
    return coupling @ np.eye(coupling.nodes)
