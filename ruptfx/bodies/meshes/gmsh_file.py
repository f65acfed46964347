"""A mesh file with named bodies and interfaces: .geo and .msh of Gmsh, or any format that meshio reads."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.spatial import cKDTree

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import COINCIDENT, FACETS, MeshSource, RawMesh, _geo, _mesh_file
from ruptfx.bodies.meshes._cut import Facets, places
from ruptfx.input.schema import NAME, CasePath, Name, OwnJsonSchema, Part, Unit
from ruptfx.input.units import Positive

OBLIQUE = 0.1  # least cosine of the angle between the normal of a facet and the one in the case
# Edges of hexahedra.
RIDGES = [(0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7)]
FLAT = 1e-6  # of the extent: largest range of the third coordinate of a plane mesh

OneOrMore = Annotated[
    list[str], Field(min_length=1), BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
    OwnJsonSchema({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}),
]  # fmt: skip
"""Names of bodies, or the name of one."""


def _with_names_of_cases(interfaces: object) -> object:
    """Propose the table `names` for interfaces that have names of mesh files."""
    for name in interfaces if isinstance(interfaces, dict) else ():
        if not re.fullmatch(NAME, str(name)):
            word = re.sub(r"[\W_]+", "_", str(name), flags=re.A).strip("_")
            word = word if word[:1].isalpha() else f"fault_{word}"
            raise ValueError(
                f"'{name}' is a name of the mesh file; in a case an interface has a letter, then letters, digits "
                f'and _: call it {word} here and in [faults], and add names = {{ {word} = "{name}" }} to [mesh]'
            )
    return interfaces


def _a_group(value: object) -> object:
    if isinstance(value, dict):
        raise ValueError("is a table; write names with a dot in quotation marks")
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise ValueError("must be the name of a group in the mesh file, or its number")
    return value


Group = Annotated[str | int, BeforeValidator(_a_group)]
"""Name or number of a group of a mesh file."""


class Sides(Part):
    """Bodies on either side of an interface, one or several; its normal points from minus to plus."""

    plus: OneOrMore
    """Body or bodies on the side that the normal points to."""
    minus: OneOrMore
    """Body or bodies on the other side."""
    matching: bool = True
    """True if the nodes of both sides coincide; else the interface needs `[faults.NAME.sliding]`."""
    normal: Annotated[list[float], Field(min_length=2, max_length=3), Unit("1")] | None = None
    """Direction from minus to plus of an interface with the same body on both sides: about that of its normal."""


class GmshFile(MeshSource):
    """A mesh file whose physical groups name the bodies, the interfaces and the edges.

    Bodies that share nodes are welded, except along the interfaces: there they are cut apart, and where an interface
    ends inside they stay connected. The two sides of an interface may also have their own nodes at equal positions, or,
    with `matching = false`, at different positions.
    Other named lines on the boundary of a body become edges, under the name they have in the file. Where two
    interfaces follow each other, the point they share belongs to the one that is listed first, with the area of both.
    Where one ends on another that goes on (a branch), its last node is welded; where two cross, the halves of one need
    two names. An interface may lie inside one body, which is then on both sides, with `normal`.
    Quadrilaterals of nine nodes and hexahedra of 27 (`Mesh.ElementOrder = 2`) follow curved outlines and surfaces with
    parabolas.
    """

    example: ClassVar[str] = (
        '{ kind = "gmsh_file", file = "two_bodies.geo", interfaces = { main = { plus = "upper", minus = "lower" } } }'
    )

    file: CasePath
    """Mesh of Gmsh (`.msh`), MED, UNV, Abaqus or another format with groups of elements, or a `.geo` script."""
    interfaces: Annotated[dict[Name, Sides], BeforeValidator(_with_names_of_cases)] = {}
    """Bodies on the sides of each interface, by name of the physical group."""
    names: dict[str, Group] = {}
    """Name or number in the file of the group of a body, an interface or an edge, by its name in the case."""
    scale: Positive = 1.0
    """Metres per length unit of the file."""
    trust: bool = False
    """Allow a .geo file to run commands, write files and read outside of its directory, with your permissions."""

    def files(self) -> list[Path]:
        path = Path(self.file)
        return [path, *(_geo.sources(path) if path.suffix == ".geo" else _mesh_file.sources(path))]

    def remarks(self) -> dict[str, str]:
        names = ", ".join(f"{name} = {group!r}" for name, group in self.names.items())
        return {"mesh.names": names} if names else {}

    def build(self) -> RawMesh:
        sides_of = {name: [*sides.plus, *sides.minus] for name, sides in self.interfaces.items()}
        read = _mesh_file.read(Path(self.file), self.trust, sides_of, self.names)
        points, cell, cells, bodies, cell_body, named, middle = read
        axes = self._axes(points, 3 if cell in ("hexahedron", "tetrahedron") else 2)
        points = points[:, axes] * self.scale
        known = Facets(cells, FACETS[cell])
        numbers = {name: known.find(facets) for name, facets in named.items()}
        entries = {name: known.cells[number] for name, number in numbers.items()}  # [-1] where there is none
        for name, number in numbers.items():
            entries[name][number < 0] = -1
        cuts = [np.zeros(0, dtype=int), *(numbers[name][entries[name][:, 1] >= 0] for name in self.interfaces)]
        cut_cells, origin = known.cut(np.concatenate(cuts))
        raw = RawMesh(cell, np.concatenate([points, points[origin]]), cut_cells, bodies, cell_body)

        def on(facets: np.ndarray, cell: np.ndarray) -> np.ndarray:
            """Facets by the vertices that their cells have now."""
            return np.take_along_axis(cut_cells[cell], places(cells[cell], facets), axis=1)

        faults = {name: named.pop(name) for name in self.interfaces}
        for name, sides in self.interfaces.items():
            others = (facets.ravel() for other, facets in faults.items() if other != name)
            crossed = np.concatenate([np.zeros(0, dtype=int), *others])
            raw.interfaces[name] = self._interface(raw, name, sides, faults[name], entries[name], on, crossed)
        for name, facets in named.items():
            if self._is_edge(raw, name, entries[name], facets):
                raw.edges[name] = on(facets, entries[name][:, 0])
        chosen = [name for name in raw.edges if name in self.names or name.partition(".")[0] in bodies]
        shared = np.concatenate([np.zeros(0, dtype=int), *(numbers[name] for name in (*self.interfaces, *chosen))])
        for name in raw.edges.keys() - chosen:  # as sets of Abaqus for all elements that are listed together
            if np.isin(numbers[name], shared).any():
                del raw.edges[name]
        return _curved(raw, middle[..., axes] * self.scale) if middle.shape[1] else raw

    def _axes(self, points: np.ndarray, dim: int) -> list[int]:
        """Return the coordinates of the file that are those of the model: of plane meshes the two that vary."""
        extent = np.ptp(points, axis=0)
        flat = np.flatnonzero(extent <= FLAT * extent.max())
        if points.shape[1] > dim and not len(flat):
            low, high = points.min(axis=0), points.max(axis=0)
            ranges = ", ".join(f"{name} {a:.6g} to {b:.6g}" for name, a, b in zip("xyz", low, high, strict=True))
            raise RuptfxError(
                f"{self.file}: the elements are in none of the planes x-y, x-z and y-z: {ranges}; rotate them into one"
            )
        return [axis for axis in range(points.shape[1]) if points.shape[1] == dim or axis != flat[-1]]

    def _interface(
        self, raw: RawMesh, name: str, sides: Sides, facets: np.ndarray, cells: np.ndarray, on: Any, crossed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return facets of both sides, in the same order vertex by vertex if they match.

        `crossed` are the vertices of other interfaces.
        """
        body = np.where(cells >= 0, raw.cell_body[cells], -1)  # the last: no body
        may_be = np.zeros((2, len(raw.bodies) + 1), dtype=int)
        may_be[0, [raw.bodies.index(body) for body in sides.plus]] = 1
        may_be[1, [raw.bodies.index(body) for body in sides.minus]] = 1
        side = may_be[0, body] - may_be[1, body]
        if sides.normal is None and (both := set(sides.plus) & set(sides.minus)):
            raise RuptfxError(
                f"{self.file}: interface '{name}': the body {', '.join(sorted(both))} is on both sides, plus "
                f"({', '.join(sides.plus)}) and minus ({', '.join(sides.minus)}); name it in one of them, or, if the "
                f"interface lies inside of it, say to which side it has its normal, {_proposed(raw.points, facets)}"
            )
        if sides.normal is not None:
            above = self._is_above(raw, name, sides.normal, facets, cells)
            side = np.where(above, may_be[0, body], -may_be[1, body])
        between = side[:, 0] * side[:, 1] == -1
        alone = (side[:, 0] != 0) & (cells[:, 1] < 0)
        if not np.all(between | alone):
            bad = int(np.argmin(between | alone))
            touching = " and ".join(f"'{raw.bodies[b]}'" for b in body[bad] if b >= 0) or "no body"
            raise RuptfxError(
                f"{self.file}: interface '{name}' has {np.sum(~between & ~alone)} facets that are not between plus "
                f"({', '.join(sides.plus)}) and minus ({', '.join(sides.minus)}), the first at "
                f"{_place(raw, facets[bad])} on {touching}; list these bodies, too, or leave the facets out"
            )
        first = side[:, 0] == 1
        plus = on(facets[between], np.where(first, cells[:, 0], cells[:, 1])[between])
        minus = on(facets[between], np.where(first, cells[:, 1], cells[:, 0])[between])
        if np.any(np.all(plus == minus, axis=1)):
            bad = int(np.argmax(np.all(plus == minus, axis=1)))
            raise RuptfxError(
                f"{self.file}: interface '{name}' is one facet wide at {_place(raw, plus[bad])} and does not open "
                "there; refine the mesh along it"
            )
        if sides.normal is not None:
            self._check_continues(raw, name, facets[between], (plus, minus), crossed)
        own_plus, own_minus = (on(facets[alone & which], cells[alone & which, 0]) for which in (first, ~first))
        _check_sides(self.file, name, len(plus) + len(own_plus), len(minus) + len(own_minus))
        if not sides.matching:
            raw.non_matching.add(name)
        elif alone.any() or not len(facets):
            own_minus = _partners(self.file, name, raw.points, own_plus, own_minus)
        return np.concatenate([plus, own_plus]), np.concatenate([minus, own_minus])

    def _is_above(
        self, raw: RawMesh, name: str, normal: list[float], facets: np.ndarray, cells: np.ndarray
    ) -> np.ndarray:
        """Return whether the cells beside facets are on the side that the normal points to, shape (facets, 2)."""
        dim = raw.points.shape[1]
        if len(normal) != dim or not np.any(normal):
            raise RuptfxError(
                f"{self.file}: mesh.interfaces.{name}.normal = {normal}: must have {dim} components, not all zero"
            )
        corners, across = raw.points[facets], _normals(raw.points, facets)
        cosine = across @ np.array(normal) / (np.linalg.norm(across, axis=1) * np.linalg.norm(normal))
        if np.any(np.abs(cosine) < OBLIQUE):
            bad = int(np.argmin(np.abs(cosine)))
            direction = ", ".join(f"{x:.3g}" for x in across[bad] / np.linalg.norm(across[bad]))
            raise RuptfxError(
                f"{self.file}: interface '{name}' at {_place(raw, facets[bad])} has the normal ({direction}) or its "
                f"opposite, at a right angle to mesh.interfaces.{name}.normal = {normal}; choose another one, "
                f"{_proposed(raw.points, facets)}, or name the part with it as an interface of its own"
            )
        toward = raw.points[raw.cells[cells]].mean(axis=2) - corners.mean(axis=1)[:, None]
        return np.einsum("fci,fi->fc", toward, across * np.sign(cosine)[:, None]) > 0

    def _check_continues(
        self, raw: RawMesh, name: str, facets: np.ndarray, sides: tuple[np.ndarray, np.ndarray], crossed: np.ndarray
    ) -> None:
        """Refuse an interface inside a body that branches, or that turns its plus side over at a vertex."""
        for side in sides:
            vertex, count = np.unique(np.unique(np.stack([facets, side], axis=-1).reshape(-1, 2), axis=0)[:, 0],
                                      return_counts=True)  # fmt: skip
            bad = np.setdiff1d(vertex[count > 1], crossed)
            if len(bad):
                raise RuptfxError(
                    f"{self.file}: interface '{name}' branches at {_place(raw, bad[:1])}, or its side of "
                    f"mesh.interfaces.{name}.normal changes there; give its parts own names, with a normal each"
                )

    def _is_edge(self, raw: RawMesh, name: str, cells: np.ndarray, facets: np.ndarray) -> bool:
        """Return whether a name belongs to facets on the boundary of a body; refuse a mixture."""
        outside = (cells[:, 0] >= 0) & (cells[:, 1] < 0)
        claims_to_be = name.partition(".")[0] in raw.bodies
        if not outside.all() and (outside.any() or claims_to_be):
            bad = int(np.argmin(outside))
            touching = " and ".join(f"'{raw.bodies[raw.cell_body[cell]]}'" for cell in cells[bad] if cell >= 0)
            raise RuptfxError(
                f"{self.file}: edge '{name}' has {np.sum(~outside)} facets that are not on the boundary of a body, the "
                f"first at {_place(raw, facets[bad])} "
                + (f"between {touching}, which share its nodes; " if touching else "on no body; ")
                + "give every body its own nodes there, or leave these facets out"
            )
        return bool(outside.all())


def _normals(points: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Return a normal of every facet, of either sign, in proportion to its size; shape (facets, dim)."""
    along = points[facets[:, 1]] - points[facets[:, 0]]
    if points.shape[1] == 2:
        return along @ np.array([[0, 1], [-1, 0]])
    return np.cross(along, points[facets[:, 2]] - points[facets[:, 0]])


def _proposed(points: np.ndarray, facets: np.ndarray) -> str:
    """Return the direction closest to the normals of all facets as text, if it is at a right angle to none."""
    normals = _normals(points, facets)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    direction = np.linalg.eigh(normals.T @ normals)[1][:, -1]
    rounded = np.round(direction / direction[np.argmax(np.abs(direction))], 2) + 0.0
    if np.all(np.abs(normals @ rounded) >= OBLIQUE * np.linalg.norm(rounded)):
        return f"as normal = {rounded.tolist()}"
    return "as a direction that is nowhere at a right angle to it"


def _curved(raw: RawMesh, middle: np.ndarray) -> RawMesh:
    """Return second-order cells: with a node on every side, of solids also on every facet, and one inside.

    Nodes on cuts are duplicated; nodes of both sides of an interface that coincide are put at one place.

    Parameters
    ----------
    middle : ndarray, shape (cells, 5, 2) or (cells, 19, 3)
        Coordinates of these nodes, in the order of DOLFINx [m].
    """
    points, cells, number = [raw.points], [raw.cells], 0
    partner = np.arange(len(raw.points))
    for name, (plus, minus) in raw.interfaces.items():
        if name not in raw.non_matching:
            partner[minus] = plus
    for entities in (*((RIDGES,) if raw.cell == "hexahedron" else ()), FACETS[raw.cell]):
        keys = np.sort(raw.cells[:, entities], axis=2).reshape(-1, len(entities[0]))
        different, first, own = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        places = middle[:, number : number + len(entities)].reshape(len(keys), -1)[first]
        minus = np.flatnonzero((partner[different] != different).any(axis=1))
        _, place = np.unique(np.concatenate([different, np.sort(partner[different[minus]], axis=1)]), axis=0,
                             return_inverse=True)  # fmt: skip
        plus = np.full(place.max(initial=0) + 1, -1)
        plus[place.ravel()[: len(different)]] = np.arange(len(different))
        plus = plus[place.ravel()[len(different) :]]
        length = np.linalg.norm(np.diff(raw.points[different[minus][:, :2]], axis=1)[:, 0], axis=1)
        same = (plus >= 0) & (np.linalg.norm(places[plus] - places[minus], axis=1) <= COINCIDENT * length)
        places[minus[same]] = places[plus[same]]
        cells.append(sum(map(len, points)) + own.reshape(len(raw.cells), -1))
        points.append(places)
        number += len(entities)
    cells.append(sum(map(len, points)) + np.arange(len(raw.cells))[:, None])
    return replace(
        raw, points=np.concatenate([*points, middle[:, number]]), cells=np.concatenate(cells, axis=1), order=2
    )


def _place(raw: RawMesh, facet: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in raw.points[facet].mean(axis=0)) + ") m"


def _check_sides(file: str, name: str, plus: int, minus: int) -> None:
    if not plus or not minus:
        raise RuptfxError(
            f"{file}: interface '{name}' has {plus} facets on its plus and {minus} on its minus side; name those of "
            "both"
        )


def _partners(file: str, name: str, points: np.ndarray, plus: np.ndarray, minus: np.ndarray) -> np.ndarray:
    """Return the minus facets in the order of the plus facets, and move their nodes onto those of the plus side.

    Raises
    ------
    RuptfxError
        Nodes that do not coincide.
    """
    minus_nodes, plus_nodes = np.unique(minus), np.unique(plus)
    distance, nearest = cKDTree(points[minus_nodes]).query(points[plus_nodes])
    ends = points[np.concatenate([plus, minus])]
    near = COINCIDENT * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()
    unmatched, worst = int(np.sum(distance > near)), int(np.argmax(distance))
    partner = np.zeros(len(points), dtype=np.int64)
    partner[plus_nodes] = minus_nodes[nearest]
    if unmatched or not np.array_equal(np.sort(partner[plus_nodes]), minus_nodes):
        place = ", ".join(f"{x:.6g}" for x in points[plus_nodes[worst]])
        raise RuptfxError(
            f"{file}: interface '{name}': the nodes of the two sides do not match ({len(plus_nodes)} on the plus, "
            f"{len(minus_nodes)} on the minus side, {unmatched} without a partner: the plus node at ({place}) m is "
            f"{distance[worst]:.3g} m from the nearest one, nodes closer than {COINCIDENT:g} of the shortest facet, "
            f"{near:.3g} m, coincide); mesh both sides alike, write the coordinates with more digits, or let it slide: "
            f"matching = false here, and the table [faults.{name}.sliding]"
        )
    points[partner[plus_nodes]] = points[plus_nodes]
    return partner[plus]
