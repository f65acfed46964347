"""A plane body with a straight fault and a branch that ends on it."""

from __future__ import annotations

from itertools import chain
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, MeshSource, RawMesh
from ruptfx.bodies.meshes._cut import Facets, places
from ruptfx.bodies.meshes._gmsh import session
from ruptfx.bodies.meshes._lattice import affordable
from ruptfx.input.quantities import at_most
from ruptfx.input.schema import Unit
from ruptfx.input.units import Coordinate, Length

FRONTAL_QUADS = 8  # of Gmsh: triangles that pair to quadrilaterals
FROM_CORNER = 0.1  # of a side: least distance from a corner at which the continuation of the branch leaves the body


class BranchedFault(MeshSource):
    """Quadrilaterals around a fault along y = 0, the interface `main`, and a straight one that ends on it, `branch`.

    The fault and the branch end inside the body; beyond their ends it is welded, as at the last node of the branch on
    the fault. The bodies are `plus` above and `minus` below the fault, and `wedge` between the branch and the part of
    the fault to the right of it, below the fault if the branch points down. Slip of the branch is that of its left
    side, seen from its beginning, relative to its right side, as on the fault. The edges are `plus.left`, `plus.right`,
    `plus.top`, `minus.left`, `minus.right`, `minus.bottom`, and the sides of the body that `wedge` reaches (for the
    part to which the branch points, `wedge.right` and, if it is steep, `wedge.bottom` or `wedge.top`).
    """

    example: ClassVar[str] = (
        '{ kind = "branched_fault", left = -4e-3, right = 4e-3, branch_length = 3e-3, angle = -35.0, '
        "element_size = 1e-3, beyond = 3e-3, growth = 1.1 }"
    )

    left: Coordinate
    """x of the left end of the fault."""
    right: Coordinate
    """x of its right end."""
    junction: Coordinate = 0.0
    """x of the point at which the branch begins."""
    branch_length: Length
    """Length of the branch."""
    angle: Annotated[float, Unit("degree")]
    """Direction of the branch, anticlockwise from x: 20 to 160 degrees, negative for a branch that points down."""
    element_size: Length
    """On both faults; the spacing of nodes is this over the order."""
    beyond: Length
    """Distance of the edges of the body from the ends of both faults, and from the fault."""
    growth: Annotated[float, Field(ge=1, le=1.3), Unit("1")] = 1.1
    """Ratio of the sizes of neighbouring elements away from both faults."""

    @model_validator(mode="after")
    def _branch_begins_on_the_fault(self) -> BranchedFault:
        nearest = 2 * self.element_size
        if not self.left + nearest <= self.junction <= self.right - nearest:
            raise ValueError(
                f"junction = {self.junction:g} m: the branch begins on the fault, at least two elements of "
                f"element_size = {self.element_size:g} m from its ends, left = {self.left:g} m and right = "
                f"{self.right:g} m"
            )
        if not 20 <= abs(self.angle) <= 160:
            raise ValueError(
                f"angle = {self.angle:g} degrees: must be 20 to 160, or -160 to -20; elements between the fault and a "
                "branch closer to it are too flat"
            )
        if self.branch_length < nearest:
            raise ValueError(
                f"branch_length = {self.branch_length:g} m: must be at least two elements; make element_size at most "
                f"{at_most(self.branch_length / 2)} m"
            )
        return self

    def build(self) -> RawMesh:
        points, cells, part, lines = self._mesh()
        divided, undivided = ("minus", "plus") if self.angle < 0 else ("plus", "minus")
        bodies = ["plus", "minus", "wedge"]
        cell_body = np.array([bodies.index(name) for name in (undivided, divided, "wedge")])[part]
        if self.angle > 0:
            points = points * (1.0, -1.0)
        diagonals = points[cells[:, 3]] - points[cells[:, 0]], points[cells[:, 2]] - points[cells[:, 1]]
        clockwise = diagonals[0][:, 0] * diagonals[1][:, 1] < diagonals[0][:, 1] * diagonals[1][:, 0]
        cells[clockwise] = cells[clockwise][:, [1, 0, 3, 2]]
        known = Facets(cells, FACETS["quadrilateral"])
        number = {name: known.find(facets) for name, facets in lines.items()}
        cut, origin = known.cut(np.concatenate(list(number.values())))
        raw = RawMesh("quadrilateral", np.concatenate([points, points[origin]]), cut, bodies, cell_body)

        def side(name: str, of_bodies: list[str]) -> np.ndarray:
            adjacent = known.cells[number[name]]
            second = np.isin(cell_body[adjacent[:, 1]], [bodies.index(body) for body in of_bodies])
            own = np.where(second, adjacent[:, 1], adjacent[:, 0])
            return np.take_along_axis(cut[own], places(cells[own], lines[name]), axis=1)

        above, below = (["plus"], ["minus", "wedge"]) if self.angle < 0 else (["plus", "wedge"], ["minus"])
        raw.interfaces["main"] = side("main", above), side("main", below)
        left, right = ("wedge", "minus") if self.angle < 0 else ("plus", "wedge")
        raw.interfaces["branch"] = side("branch", [left]), side("branch", [right])
        outer = known.cells[:, 1] < 0
        body = cell_body[known.cells[outer, 0]]
        facets = known.vertices[outer]
        middle = points[facets].mean(axis=1)
        near = 1e-6 * self.element_size
        for column, names in enumerate((("left", "right"), ("bottom", "top"))):
            for name, level in zip(names, (points[:, column].min(), points[:, column].max()), strict=True):
                for index, of_body in enumerate(bodies):
                    chosen = (np.abs(middle[:, column] - level) < near) & (body == index)
                    if chosen.any():
                        raw.edges[f"{of_body}.{name}"] = facets[chosen]
        return raw

    def _outline(self) -> tuple[np.ndarray, list[int], list[int]]:
        """Return points of the geometry with the branch below the fault, and the outlines of `wedge` and `minus`.

        The first points are the upper corners, then along y = 0 the ends of the body and of the fault around the
        junction, then the end of the branch, the point at which its continuation leaves the body, the lower corners.
        """
        angle = np.deg2rad(abs(self.angle))
        along = np.array([np.cos(angle), -np.sin(angle)])
        start = np.array([self.junction, 0.0])
        end = start + self.branch_length * along
        low = np.array([min(self.left, end[0]), end[1]]) - self.beyond
        high = np.array([max(self.right, end[0]), 0.0]) + self.beyond
        sides = np.array([(high[0] if along[0] > 0 else low[0]) - start[0], low[1]])
        distance = sides / np.where(np.abs(along) > 1e-12, along, 1e-12)
        leaves = start + distance.min() * along
        aside = FROM_CORNER * (high - low)
        if distance[1] <= distance[0]:  # below
            leaves = np.array([np.clip(leaves[0], low[0] + aside[0], high[0] - aside[0]), low[1]])
        else:
            leaves = np.array([start[0] + sides[0], max(leaves[1], low[1] + aside[1])])
        points = np.array([
            (low[0], high[1]), high, (low[0], 0.0), (self.left, 0.0), start, (self.right, 0.0), (high[0], 0.0),
            end, leaves, low, (high[0], low[1]),
        ])  # fmt: skip
        if distance[1] <= distance[0]:
            right, left = [10], [9]
        elif along[0] > 0:
            right, left = [], [10, 9]
        else:
            right, left = [10, 9], []
        return points, [4, 5, 6, *right, 8, 7], [2, 3, 4, 7, 8, *left]

    def _mesh(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return points, cells, number of the part of every cell and facets of both faults; the branch points down.

        Gmsh makes elements twice as large, which are then divided: so all are quadrilaterals.
        """
        outline, wedge, minus = self._outline()
        faults = {"main": [(3, 4), (4, 5)], "branch": [(4, 7)]}
        width, height = np.ptp(outline, axis=0)
        affordable(width / self.element_size), affordable(height / self.element_size)
        with session() as gmsh:
            geo, mesh = gmsh.model.geo, gmsh.model.mesh
            corners = [geo.addPoint(x, y, 0.0) for x, y in outline]
            curves: dict[tuple[int, int], int] = {}

            def curve(first: int, second: int) -> int:
                if (second, first) in curves:
                    return -curves[second, first]
                if (first, second) not in curves:
                    curves[first, second] = geo.addLine(corners[first], corners[second])
                return curves[first, second]

            surfaces = [
                geo.addPlaneSurface([geo.addCurveLoop([curve(*ends) for ends in zip(loop, [*loop[1:], loop[0]],
                                                                                   strict=True)])])
                for loop in ([2, 3, 4, 5, 6, 1, 0], minus, wedge)
            ]  # fmt: skip
            geo.synchronize()
            on_faults = {name: [abs(curve(*ends)) for ends in parts] for name, parts in faults.items()}
            for ends in chain(*faults.values()):
                length = float(np.linalg.norm(outline[ends[1]] - outline[ends[0]]))
                mesh.setTransfiniteCurve(abs(curve(*ends)), int(np.ceil(length / self.element_size / 2 - 1e-9)) + 1)
            away = mesh.field.add("Distance")
            mesh.field.setNumbers(away, "CurvesList", list(chain(*on_faults.values())))
            mesh.field.setNumber(away, "Sampling", 200)
            size = mesh.field.add("MathEval")
            # Elements that grow by a ratio have a size that grows linearly with the distance.
            mesh.field.setString(size, "F", f"{2 * self.element_size:.16g} + {self.growth - 1:.16g} * F{away}")
            mesh.field.setAsBackgroundMesh(size)
            for option, value in (
                ("MeshSizeExtendFromBoundary", 0), ("MeshSizeFromPoints", 0), ("Algorithm", FRONTAL_QUADS),
                ("RecombineAll", 1), ("SubdivisionAlgorithm", 1), ("Smoothing", 10),
            ):  # fmt: skip
                gmsh.option.setNumber(f"Mesh.{option}", value)
            try:
                mesh.generate(2)
            except Exception as error:
                raise RuptfxError(
                    f"Gmsh could not mesh the body: {error}; change mesh.angle or mesh.element_size"
                ) from None
            tags, coordinates, _ = mesh.getNodes()
            number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
            number[tags] = np.arange(len(tags))

            def elements(dim: int, entity: int) -> np.ndarray:
                nodes = np.concatenate(mesh.getElements(dim, entity)[2]).astype(np.int64)
                return number[nodes.reshape(-1, 2 * dim)]

            cells = [elements(2, surface)[:, [0, 1, 3, 2]] for surface in surfaces]
            lines = {name: np.concatenate([elements(1, one) for one in cell]) for name, cell in on_faults.items()}
        part = np.repeat(np.arange(3), [len(cell) for cell in cells])
        used, renumbered = np.unique(np.concatenate(cells), return_inverse=True)
        place = np.full(len(tags), -1)
        place[used] = np.arange(len(used))
        points = coordinates.reshape(-1, 3)[used, :2]
        return points, renumbered.reshape(-1, 4), part, {name: place[cell] for name, cell in lines.items()}
