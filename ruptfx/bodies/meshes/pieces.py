"""Separate bodies of triangles: rectangles and discs that may fly, collide and fracture."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Tag

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._gmsh import Geometry, session
from ruptfx.bodies.meshes.specimen import DELAUNAY, MOST_CELLS, Floats, Ints, Point
from ruptfx.input.schema import CaseError, Name, Part, Unit, by_kind
from ruptfx.input.units import Length


class RectanglePiece(Part):
    """A rectangle."""

    kind: Literal["rectangle"] = "rectangle"
    center: Point
    """Its middle."""
    width: Length
    """Along x before it is turned."""
    height: Length
    """Along y before it is turned."""
    angle: Annotated[float, Unit("degree")] = 0.0
    """Rotation angle, counter-clockwise."""
    element_size: Length | None = None
    """Of its triangles; left out, that of the mesh."""

    @property
    def area(self) -> float:
        return self.width * self.height

    def draw(self, occ: Geometry) -> int:
        x, y = self.center
        tag = occ.addRectangle(x - self.width / 2, y - self.height / 2, 0, self.width, self.height)
        occ.rotate([(2, tag)], x, y, 0, 0, 0, 1, np.deg2rad(self.angle))
        return int(tag)

    def sides(self, middles: Floats) -> dict[str, Floats]:
        """Return the distance of points from every side, shape (n,) [m]."""
        c, s = np.cos(np.deg2rad(self.angle)), np.sin(np.deg2rad(self.angle))
        x, y = ((middles - self.center) @ np.array([[c, -s], [s, c]])).T
        return {
            "left": np.abs(x + self.width / 2), "right": np.abs(x - self.width / 2),
            "bottom": np.abs(y + self.height / 2), "top": np.abs(y - self.height / 2),
        }  # fmt: skip


class DiscPiece(Part):
    """A disc."""

    kind: Literal["disc"] = "disc"
    center: Point
    """Its middle."""
    diameter: Length
    """Diameter of the circle through its outer vertices."""
    element_size: Length | None = None
    """Of its triangles; left out, that of the mesh."""

    @property
    def area(self) -> float:
        return np.pi * self.diameter**2 / 4

    def draw(self, occ: Geometry) -> int:
        return int(occ.addDisk(self.center[0], self.center[1], 0, self.diameter / 2, self.diameter / 2))

    def sides(self, middles: Floats) -> dict[str, Floats]:
        return {"side": np.zeros(len(middles))}


class Pieces(MeshSource):
    """Separate rectangles and discs of triangles, one body each; their contact needs `[collisions]`.

    Edges: `BODY.left`, `BODY.right`, `BODY.bottom`, `BODY.top` of a rectangle, `BODY.side` of a disc.
    """

    example: ClassVar[str] = (
        '{ kind = "pieces", element_size = 1e-3, bodies = { '
        'plate = { kind = "rectangle", center = [0.0, 0.0], width = 6e-3, height = 2e-3 }, '
        'ball = { kind = "disc", center = [0.0, 3e-3], diameter = 3e-3 } } }'
    )

    bodies: dict[
        Name,
        Annotated[
            Annotated[RectanglePiece, Tag("<rectangle>")] | Annotated[DiscPiece, Tag("<disc>")],
            by_kind("rectangle", "disc"),
        ],
    ]
    """Bodies by name."""
    element_size: Length
    """Mean edge of the triangles."""

    def build(self) -> RawMesh:
        if not self.bodies:
            raise CaseError("mesh.bodies: there is none; add a table [mesh.bodies.NAME]")
        parts = [self._mesh(name, body) for name, body in self.bodies.items()]
        first = np.cumsum([0, *(len(points) for points, _ in parts)])
        points = np.concatenate([points for points, _ in parts])
        cells = np.concatenate([part + begin for (_, part), begin in zip(parts, first, strict=False)])
        cell_body = np.repeat(np.arange(len(parts)), [len(part) for _, part in parts])
        raw = RawMesh("triangle", points, cells, list(self.bodies), cell_body)
        for name, (_, part), begin in zip(self.bodies, parts, first, strict=False):
            sides = np.sort((part + begin)[:, [[1, 2], [0, 2], [0, 1]]].reshape(-1, 2), axis=1)
            sides, count = np.unique(sides, axis=0, return_counts=True)
            outer = sides[count == 1]
            result = self.bodies[name].sides(points[outer].mean(axis=1))
            nearest = np.argmin([*result.values()], axis=0)
            for number, side in enumerate(result):
                raw.edges[f"{name}.{side}"] = outer[nearest == number]
        return raw

    def _mesh(self, name: str, body: RectanglePiece | DiscPiece) -> tuple[Floats, Ints]:
        """Return points and triangles of one body."""
        size = body.element_size or self.element_size
        if body.area / (np.sqrt(3) / 4 * size**2) > MOST_CELLS:
            raise CaseError(
                f"mesh.bodies.{name}.element_size = {size:g} m: would make more than {MOST_CELLS:.0g} triangles; make "
                "it larger"
            )
        with session() as gmsh:
            try:
                gmsh.option.setNumber("Mesh.Algorithm", DELAUNAY)
                gmsh.option.setNumber("Mesh.MeshSizeMin", size)
                gmsh.option.setNumber("Mesh.MeshSizeMax", size)
                body.draw(gmsh.model.occ)
                gmsh.model.occ.synchronize()
                gmsh.model.mesh.generate(2)
                tags, coordinates, _ = gmsh.model.mesh.getNodes()
                corners = np.concatenate(gmsh.model.mesh.getElements(2)[2]).astype(np.int64).reshape(-1, 3)
            except Exception as error:
                raise RuptfxError(f"Gmsh could not mesh mesh.bodies.{name}: {error}") from None
        number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        number[tags] = np.arange(len(tags))
        used, cells = np.unique(number[corners], return_inverse=True)
        return coordinates.reshape(-1, 3)[used, :2], cells.reshape(-1, 3)
