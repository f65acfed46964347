"""A plug-in: triangles for tests, rectangles without Gmsh and a fault with a branch."""

from __future__ import annotations

import numpy as np

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes.branched_fault import BranchedFault
from ruptfx.input.units import Coordinate, Length


class Triangles(MeshSource):
    """Squares cut along their diagonals, inner vertices moved at random; one body below `divide`, another one above."""

    width: Length
    height: Length
    element_size: Length
    divide: Coordinate = -1.0
    """y of the border between the bodies `lower` and `upper`; all is `rock` where it is outside."""
    turn: float = 0.0
    """Of each square by up to this part of its size."""
    fault: bool = False
    """Whether the border is the interface `main`, with nodes of its own on either side, instead of facets."""

    def build(self) -> RawMesh:
        m, n = (max(1, round(length / self.element_size)) for length in (self.width, self.height))
        x, y = np.meshgrid(np.linspace(0, self.width, m + 1), np.linspace(0, self.height, n + 1), indexing="ij")
        points = np.stack([x, y], axis=-1)
        moved = np.random.default_rng(1).uniform(-self.turn, self.turn, points.shape) * self.element_size
        inner = np.zeros((m + 1, n + 1), dtype=bool)
        inner[1:-1, 1:-1] = True
        if 0 < self.divide < self.height:
            inner &= np.abs(y - self.divide) > 1e-9 * self.height
        points[inner] += moved[inner]
        number = np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
        a, b, c, d = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
        even = (np.add.outer(np.arange(m), np.arange(n)) % 2 == 0)[..., None]
        first = np.where(even, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
        second = np.where(even, np.stack([a, d, c], -1), np.stack([b, d, c], -1))
        cells = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
        points = points.reshape(-1, 2)
        bodies, cell_body = ["rock"], np.zeros(len(cells), dtype=int)
        if 0 < self.divide < self.height:
            bodies, cell_body = ["lower", "upper"], (points[cells].mean(axis=1)[:, 1] > self.divide).astype(int)

        def chain(line: np.ndarray) -> np.ndarray:
            return np.stack([line[:-1], line[1:]], axis=1)

        edges = {f"{bodies[0]}.bottom": chain(number[:, 0]), f"{bodies[-1]}.top": chain(number[:, -1])}
        interfaces = {}
        if self.fault:
            minus = number[:, round(self.divide / self.height * n)]
            plus = len(points) + np.arange(m + 1)
            points = np.concatenate([points, points[minus]])
            above = np.zeros(len(points), dtype=np.int64)
            above[:] = np.arange(len(points))
            above[minus] = plus
            cells = np.where(cell_body[:, None] == 1, above[cells], cells)
            interfaces["main"] = (chain(plus), chain(minus))
        if len(bodies) == 1:
            edges |= {"rock.left": chain(number[0]), "rock.right": chain(number[-1])}
        return RawMesh("triangle", points, cells, bodies, cell_body, edges=edges, interfaces=interfaces)


class BranchedTriangles(BranchedFault):
    """The quadrilaterals of a fault with a branch, each cut along the diagonal from its lowest node."""

    def build(self) -> RawMesh:
        raw = super().build()
        ring = raw.cells[:, [0, 1, 3, 2]]  # around each quadrilateral
        # From the junction, so that no triangle there has a side on both interfaces.
        at_junction = np.linalg.norm(raw.points - [self.junction, 0.0], axis=1) < 1e-9
        first = np.where(at_junction[ring].any(axis=1), at_junction[ring].argmax(axis=1), ring.argmin(axis=1))
        a, b, c, d = np.take_along_axis(ring, (first[:, None] + np.arange(4)) % 4, axis=1).T
        raw.cells = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
        raw.cell, raw.cell_body = "triangle", np.tile(raw.cell_body, 2)
        return raw
