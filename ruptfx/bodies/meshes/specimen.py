"""A specimen of triangles for fracture: rectangle or disc, with notches, platens and mineral phases."""

from __future__ import annotations

from types import ModuleType
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, Tag

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._gmsh import Entity, Geometry, session
from ruptfx.bodies.phases import AnyPhases
from ruptfx.input.schema import CaseError, Name, Part, Unit, by_kind
from ruptfx.input.units import Coordinate, Length

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Segment: TypeAlias = Annotated[list[Coordinate], Field(min_length=4, max_length=4)]
Point: TypeAlias = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]

DELAUNAY = 5  # of Gmsh
MOST_CELLS = 5_000_000


class Rectangle(Part):
    """A rectangle around the middle of the specimen."""

    kind: Literal["rectangle"] = "rectangle"
    width: Length
    """Along x."""
    height: Length
    """Along y."""


class Disc(Part):
    """A disc with two flats, below and above, as it is pressed in a splitting test."""

    kind: Literal["disc"] = "disc"
    diameter: Length
    """Diameter without the flats."""
    flat: Annotated[float, Field(ge=0, lt=90), Unit("degree")] = 20.0
    """Angle that each flat subtends at the centre; no flats at 0."""


class Platens(Part):
    """Blocks below and above, which share the nodes of the specimen."""

    thickness: Length
    """Along y."""
    body: Name = "platen"
    """Body name of both, also that of their material."""


class Specimen(MeshSource):
    """A specimen of triangles around `center`; without `[fracture]` it does not break.

    Its body is `specimen`, or the phases that fill it. Edges: `specimen.left`, `specimen.right`, `specimen.bottom` and
    `specimen.top` of a rectangle, `specimen.side`, `specimen.bottom` and `specimen.top` of a disc; with platens
    `BODY.bottom` and `BODY.top` are their far sides instead.
    """

    example: ClassVar[str] = (
        '{ kind = "specimen", shape = { kind = "rectangle", width = 4e-3, height = 6e-3 }, element_size = 1e-3, '
        'platens = { thickness = 1e-3 }, phases = { kind = "random_cells", fractions = { quartz = 0.4, mica = 0.6 } } }'
    )

    shape: Annotated[
        Annotated[Rectangle, Tag("<rectangle>")] | Annotated[Disc, Tag("<disc>")], by_kind("rectangle", "disc")
    ]
    """Rectangle or disc."""
    element_size: Length
    """Mean edge of the triangles."""
    center: Point = [0.0, 0.0]
    """Centre of the specimen."""
    platens: Platens | None = None
    """Blocks below and above."""
    notches: list[Segment] = []
    """Initial cracks: x and y of one end and of the other [m]."""
    joints: dict[Name, Segment] = {}
    """Lines along facets that may have their own laws, `fracture.joints.NAME`, by their ends [m]."""
    parts: dict[Name, Segment] = {}
    """Parts of edges with a name of their own, by their ends [m]: what a projectile hits. The edge that they lie on is
    what is left."""
    phases: AnyPhases | None = None
    """Minerals; each is a body with the name of the mineral."""

    def build(self) -> RawMesh:
        cells = self._area() / (np.sqrt(3) / 4 * self.element_size**2)
        if cells > MOST_CELLS:
            raise CaseError(
                f"mesh.element_size = {self.element_size:g} m would make {cells:.2g} triangles; "
                f"at most {MOST_CELLS:.0g} are made"
            )
        points, triangles, platen, lines, joints = self._mesh()
        bodies, cell_body = self._bodies(points, triangles, platen)
        raw = RawMesh("triangle", points, triangles, bodies, cell_body)
        count = _facets(triangles)
        outer = np.array([facet for facet, times in count.items() if times == 1], dtype=np.int64)
        for name, chosen in self._edges(points[outer]).items():
            raw.edges[name] = outer[chosen]
        for name, segment in self.parts.items():
            on = outer[_on_segment(points[outer], segment, self.element_size).all(axis=1)]
            if not len(on):
                raise CaseError(
                    f"mesh.parts.{name}: no part of the boundary lies between "
                    f"({segment[0]:g}, {segment[1]:g}) and ({segment[2]:g}, {segment[3]:g}) m; move them"
                )
            for other, facets in raw.edges.items():  # what has a name of its own is not the rest
                raw.edges[other] = facets[~np.isin(_codes(facets), _codes(on))]
            raw.edges[f"specimen.{name}"] = on
        if len(lines):
            inner = np.array([count[_key(line)] == 2 for line in lines])
            raw.open_facets = lines[inner]
        for name, facets in joints.items():
            inner = np.array([count.get(_key(facet), 0) == 2 for facet in facets], dtype=bool)
            if not inner.any():
                raise CaseError(f"mesh.joints.{name}: no part of it is inside of the specimen; move it")
            raw.joints[name] = facets[inner]
        return raw

    def _area(self) -> float:
        width, height = self._extent()
        return width * height

    def _extent(self) -> tuple[float, float]:
        if isinstance(self.shape, Rectangle):
            return self.shape.width, self.shape.height
        return self.shape.diameter, self.shape.diameter * float(np.cos(np.deg2rad(self.shape.flat / 2)))

    def _flat(self) -> float:
        """Return the width of the faces below the platens [m]."""
        if isinstance(self.shape, Rectangle):
            return self.shape.width
        return self.shape.diameter * float(np.sin(np.deg2rad(self.shape.flat / 2)))

    def _mesh(self) -> tuple[Floats, Ints, NDArray[np.bool_], Ints, dict[str, Ints]]:
        """Return points, triangles, platen flags of triangles, and lines of notches and joints by their points."""
        with session() as gmsh:
            try:
                gmsh.option.setNumber("Mesh.Algorithm", DELAUNAY)
                gmsh.option.setNumber("Mesh.MeshSizeMin", self.element_size)
                gmsh.option.setNumber("Mesh.MeshSizeMax", self.element_size)
                beyond, cut, of_joint = self._divide(gmsh.model.occ)
                gmsh.model.mesh.generate(2)
                tags, coordinates, _ = gmsh.model.mesh.getNodes()
                number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
                number[tags] = np.arange(len(tags))
                cells = {entity: _elements(gmsh, entity, 3) for entity in gmsh.model.getEntities(2)}
                lines = [_elements(gmsh, entity, 2) for entity in sorted(cut)]
                joints = {
                    name: np.concatenate([_elements(gmsh, entity, 2) for entity in part])
                    for name, part in of_joint.items()
                }  # fmt: skip
            except Exception as error:
                raise RuptfxError(
                    f"Gmsh could not mesh the specimen: {error}; look at mesh.notches, mesh.joints and mesh.parts"
                ) from None
        triangles = number[np.concatenate(list(cells.values()))]
        platen = np.concatenate([np.full(len(result), entity in beyond) for entity, result in cells.items()])
        used, triangles = np.unique(triangles, return_inverse=True)
        place = np.full(len(tags), -1)
        place[used] = np.arange(len(used))
        cut_lines = place[number[np.concatenate(lines)]] if lines else np.zeros((0, 2), dtype=np.int64)
        named = {name: place[number[lines]] for name, lines in joints.items()}
        return coordinates.reshape(-1, 3)[used, :2], triangles.reshape(-1, 3), platen, cut_lines, named

    def _divide(self, occ: Geometry) -> tuple[set[Entity], set[Entity], dict[str, list[Entity]]]:
        """Cut the geometry along all lines; return the entities of platens, of notches and of every joint."""
        (x, y), (_, height) = self.center, self._extent()
        box = self._box(occ)
        tools = []
        if self.platens is not None:
            flat, thick = self._flat(), self.platens.thickness
            for level in (y - height / 2 - thick, y + height / 2):
                tools.append((2, occ.addRectangle(x - flat / 2, level, 0, flat, thick)))
        segments = [*self.notches, *self.joints.values(), *self.parts.values()]
        joined = tools + [(1, _line(occ, segment)) for segment in segments]
        made = occ.fragment([(2, box)], joined)[1] if joined else [[(2, box)]]
        occ.synchronize()
        platens, lines = made[1 : 1 + len(tools)], made[1 + len(tools) :]
        notches, joints = lines[: len(self.notches)], lines[len(self.notches) :][: len(self.joints)]
        beyond = {entity for part in platens for entity in part} - set(made[0])
        return beyond, {entity for part in notches for entity in part}, dict(zip(self.joints, joints, strict=True))

    def _box(self, occ: Geometry) -> int:
        (x, y), (width, height) = self.center, self._extent()
        if isinstance(self.shape, Rectangle):
            return int(occ.addRectangle(x - width / 2, y - height / 2, 0, width, height))
        disc = occ.addDisk(x, y, 0, self.shape.diameter / 2, self.shape.diameter / 2)
        if self.shape.flat:
            rectangle = occ.addRectangle(x - width / 2, y - height / 2, 0, width, height)
            disc = occ.intersect([(2, disc)], [(2, rectangle)])[0][0][1]
        return int(disc)

    def _bodies(self, points: Floats, triangles: Ints, platen: NDArray[np.bool_]) -> tuple[list[str], Ints]:
        names = list(self.phases.fractions) if self.phases is not None else ["specimen"]
        body = np.zeros(len(triangles), dtype=np.int64)
        if self.phases is not None:
            body[~platen] = self.phases.phase_of(points[triangles[~platen]].mean(axis=1), self.element_size)
        if self.platens is not None:
            if self.platens.body in names:
                raise CaseError(f"mesh.platens.body = '{self.platens.body}' is the name of a phase, too; rename it")
            body[platen] = len(names)
            names = [*names, self.platens.body]
        present = np.unique(body)
        return [names[i] for i in present], np.searchsorted(present, body)

    def _edges(self, ends: Floats) -> dict[str, NDArray[np.bool_]]:
        """Return which outer facets, shape (facets, 2 ends, 2), belong to each edge."""
        x, y = self.center
        width, height = self._extent()
        near = 1e-6 * self.element_size
        thick = 0.0 if self.platens is None else self.platens.thickness
        faces = "specimen" if self.platens is None else self.platens.body
        edges = {
            f"{faces}.bottom": np.abs(ends[:, :, 1] - (y - height / 2 - thick)).max(axis=1) < near,
            f"{faces}.top": np.abs(ends[:, :, 1] - (y + height / 2 + thick)).max(axis=1) < near,
        }
        inside = np.abs(ends[:, :, 1] - y).max(axis=1) < height / 2 + near
        if isinstance(self.shape, Rectangle):
            edges["specimen.left"] = inside & (np.abs(ends[:, :, 0] - (x - width / 2)).max(axis=1) < near)
            edges["specimen.right"] = inside & (np.abs(ends[:, :, 0] - (x + width / 2)).max(axis=1) < near)
        else:
            radius = np.hypot(ends[:, :, 0] - x, ends[:, :, 1] - y)
            edges["specimen.side"] = np.abs(radius - self.shape.diameter / 2).max(axis=1) < near
            if self.shape.flat == 0 and self.platens is None:
                edges = {"specimen.side": edges["specimen.side"]}
        return edges


def _codes(facets: Ints) -> Ints:
    """Return one number for every facet, independent of the order of its ends."""
    low, high = np.sort(facets, axis=1).T
    return np.asarray(low * 2**32 + high)


def _key(facet: Ints) -> tuple[int, int]:
    first, second = int(facet[0]), int(facet[1])
    return (first, second) if first < second else (second, first)


def _facets(triangles: Ints) -> dict[tuple[int, int], int]:
    """Return the number of triangles of every facet."""
    sides = np.sort(triangles[:, [[1, 2], [0, 2], [0, 1]]].reshape(-1, 2), axis=1)
    result, count = np.unique(sides, axis=0, return_counts=True)
    return dict(zip(map(tuple, result.tolist()), count.tolist(), strict=True))


def _on_segment(points: Floats, segment: Segment, element_size: float) -> NDArray[np.bool_]:
    """Return which points, shape (..., 2), lie on a segment."""
    start, along = np.array(segment[:2]), np.array(segment[2:]) - np.array(segment[:2])
    length = float(np.hypot(*along))
    away = points - start
    across = np.abs(away[..., 0] * along[1] - away[..., 1] * along[0]) / length
    part = away @ along / length**2
    near = 1e-6 * element_size
    return np.asarray((across < near) & (part > -near / length) & (part < 1 + near / length))


def _line(occ: Geometry, segment: Segment) -> int:
    return int(occ.addLine(occ.addPoint(segment[0], segment[1], 0), occ.addPoint(segment[2], segment[3], 0)))


def _elements(gmsh: ModuleType, entity: Entity, vertices: int) -> Ints:
    """Return the elements of an entity by the tags of their nodes."""
    nodes = gmsh.model.mesh.getElements(*entity)[2]
    return np.concatenate(nodes).astype(np.int64).reshape(-1, vertices)
