"""Bodies, edges and the interface that a mesh becomes in a case.

A box of squares with a fault in the middle or at the bottom is `two_plates` or `half_plate`; anything else is a Gmsh
file beside the case, in which cells of one material on one side of the fault are a body.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import ConversionError, Floats, Input
from ruptfx.app.convert.sem2dpack.fault_line import FaultLine
from ruptfx.app.convert.sem2dpack.materials import Medium
from ruptfx.app.convert.sem2dpack.mesh import SIDES, Ints, Mesh
from ruptfx.bodies.meshes.lobatto import Basis


@dataclass
class Layout:
    """Data of the mesh for boundaries, faults, sources and receivers.

    Attributes
    ----------
    mesh : Mesh
    bodies : list of str
    body : ndarray of int, shape (cells,)
        Index into `bodies`.
    order : int
        Polynomial order of the elements.
    fault : tuple of int
        Tags of the fault: (5, 6) inside, (1,) at the bottom of half a model, () without.
    plates : bool
        Whether the mesh is one that ruptfx makes; else it is a Gmsh file.
    spans : dict of str to list of str
        Edges across several bodies, which periodic boundaries tie, and the edges of bodies that they consist of.
    """

    mesh: Mesh
    bodies: list[str]
    body: Ints
    order: int
    fault: tuple[int, ...]
    plates: bool
    spans: dict[str, list[str]] = field(default_factory=dict)

    @property
    def level(self) -> float:
        """Height of the fault in the input, which is y = 0 in the case [m]."""
        return float(self.mesh.points[self.mesh.sides[self.fault[0]][0, 0], 1]) if self.plates else 0.0

    def line(self) -> FaultLine:
        """Return the line of the fault.

        Raises
        ------
        ConversionError
            The mesh has no such fault.
        """
        if any(tag not in self.mesh.sides for tag in self.fault):
            raise ConversionError(
                f"&BC_DEF tags = {list(self.fault)}: the mesh has no such fault, but the sides "
                f"{', '.join(str(side) for side in sorted(self.mesh.sides))}; correct the tags, or split the mesh"
            )
        facets = self.mesh.points[self.mesh.sides[self.fault[0]]]
        return FaultLine.of(facets, self._normal(facets), self.order)

    def _normal(self, facets: Floats) -> Floats:
        """Return the unit normal from the minus to the plus side."""
        side = facets[:, 1] - facets[:, 0]
        normal = np.stack([side[:, 1], -side[:, 0]], axis=1)
        minus = self._minus()
        away = facets.mean(axis=1).mean(axis=0) - self.mesh.middles[minus].mean(axis=0)
        normal *= np.sign(normal @ (away if len(self.fault) > 1 else -away))[:, None]
        mean = normal.sum(axis=0)
        return np.asarray(mean / np.linalg.norm(mean))

    def _minus(self) -> NDArray[np.bool_]:
        touching = self.mesh.touching(self.fault[0])
        if len(self.mesh.rows) and len(self.fault) > 1:
            return touching & (self.mesh.rows < self.mesh.cut)
        return touching

    def mesh_table(self, file: str) -> Table:
        """Return the table ``mesh`` of the case; a Gmsh file has the name `file`."""
        if not self.plates:
            table: Table = {"kind": "gmsh_file", "file": file}
            if self.fault:
                sides = {side: self._beside(tag) for side, tag in zip(("minus", "plus"), self.fault, strict=True)}
                table["interfaces"] = {"main": sides}
            return table
        (left, low), (right, high) = self.mesh.points.min(axis=0), self.mesh.points.max(axis=0)
        halves = len(self.fault)
        return {
            "kind": "two_plates" if halves == 2 else "half_plate", "left": float(left), "length": float(right - left),
            "height": float(high - low) / halves, "element_size": self.mesh.square,
        }  # fmt: skip

    def _beside(self, tag: int) -> list[str]:
        near = self.mesh.touching(tag)
        if len(self.mesh.rows):
            near &= (self.mesh.rows < self.mesh.cut) == (tag == 5)
        return [self.bodies[number] for number in np.unique(self.body[near])]

    def materials(self, media: dict[int, Medium]) -> Table:
        """Return the table ``materials`` of the case."""
        entries = {name: media[int(self.mesh.tags[self.body == n][0])].table for n, name in enumerate(self.bodies)}
        first = next(iter(entries.values()))
        return {"default": first} if all(table == first for table in entries.values()) else entries

    def facets(self) -> dict[str, Ints]:
        """Return the facets of named edges, shape (facets, 2), by body and side."""
        entries = {}
        for side, pairs in self.mesh.sides.items():
            if side in self.fault:
                continue
            width = len(self.mesh.points)
            keys = np.sort(pairs, axis=1) @ [width, 1]
            for number, name in enumerate(self.bodies):
                cells = self.mesh.cells[self.body == number]
                own = np.sort(np.stack([cells, np.roll(cells, -1, axis=1)], axis=2), axis=2) @ [width, 1]
                if (chosen := np.isin(keys, own)).any():
                    entries[f"{name}.{SIDES.get(side, f'side_{side}')}"] = pairs[chosen]
        return entries

    def edges(self, tags: list[int]) -> list[str]:
        """Return the names of the edges of tags.

        Raises
        ------
        ConversionError
            The mesh has no such boundary.
        """
        there, result = list(self.facets()), []
        for tag in tags:
            side = SIDES.get(tag, f"side_{tag}")
            own = [name for name in there if name.rpartition(".")[2] == side]
            if not own:
                known = ", ".join(str(side) for side in sorted(self.mesh.sides))
                raise ConversionError(f"&BC_DEF tag = {tag}: no edge of this mesh; use one of {known}")
            result += own
        return result

    def across_bodies(self, tag: int) -> list[str]:
        """Return the names of edges across all bodies that are welded, one for each side of a fault through a box.

        Raises
        ------
        ConversionError
            The mesh has no such boundary.
        """
        names = self.edges([tag])
        if self.plates or len(names) == 1:
            return names
        groups = dict[str, list[str]]()
        for name in names:
            body = name.rpartition(".")[0]
            groups.setdefault(body.partition("_")[0] if len(self.mesh.rows) else "all", []).append(name)
        items = []
        for group, members in groups.items():
            span = f"{group}.{SIDES[tag]}"
            if len(members) > 1:
                self.spans[span] = members
            items += [span] if len(members) > 1 else members
        return items

    def viscous_part(self, media: dict[int, Medium]) -> Table | None:
        """Return the keys of the case for the viscous elements, a layer along the fault or bodies; None without any."""
        viscous = self._viscous(media)
        if not viscous.any():
            return None
        if (thickness := self._thickness(viscous)) is not None:
            return {"thickness": thickness}
        return {"bodies": [self.bodies[number] for number in np.unique(self.body[viscous])]}

    def viscosity_is_a_layer(self, media: dict[int, Medium]) -> bool:
        """Return whether all viscous elements, if there are any, are a layer along the fault."""
        viscous = self._viscous(media)
        return not viscous.any() or self._thickness(viscous) is not None

    def _viscous(self, media: dict[int, Medium]) -> NDArray[np.bool_]:
        tags = [tag for tag, medium in media.items() if medium.viscosity is not None]
        return np.isin(self.mesh.tags, tags)

    def _thickness(self, viscous: NDArray[np.bool_]) -> float | None:
        """Return the distance from the fault within which exactly these cells are [m]; None where there is none."""
        if not self.fault:
            return None
        # Facets are divided as finely as elements are, so that the nearest node is at the distance of the line.
        distance = cKDTree(self.line().points).query(self.mesh.middles)[0]
        inside, outside = distance[viscous].max(), distance[~viscous].min(initial=np.inf)
        if inside >= outside:
            return None
        return float(1.01 * inside if np.isinf(outside) else 0.5 * (inside + outside))

    def nodes(self) -> tuple[Floats, Ints]:
        """Return the nodes of all cells, shape (n, 2) [m], and the cell of each."""
        s = 0.5 * (1 + Basis.of_order(self.order).points)
        s, t = (each.ravel()[:, None] for each in np.meshgrid(s, s))
        a, b, c, d = np.moveaxis(self.mesh.points[self.mesh.cells], 1, 0)[:, :, None, :]
        points = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
        return points.reshape(-1, 2), np.repeat(np.arange(len(self.mesh.cells)), s.size)

    def place(self, point: tuple[float, float], at_node: bool) -> Table:
        """Return the point of a case, at the nearest node or where it is, and its body where there are several.

        A point outside of the mesh is moved to the nearest node in any case.
        """
        x, z = point
        corners = self.mesh.points[self.mesh.cells]
        side = np.roll(corners, -1, axis=1) - corners
        cross = side[..., 0] * (z - corners[..., 1]) - side[..., 1] * (x - corners[..., 0])
        within = np.flatnonzero((cross >= -1e-9 * np.sum(side**2, axis=2)).all(axis=1))
        if at_node or not len(within):
            points, cells = self.nodes()
            nearest = int(np.argmin(np.sum((points - [x, z]) ** 2, axis=1)))
            (x, z), cell = points[nearest], int(cells[nearest])
        else:
            cell = int(within[0])
        entries: Table = {"point": [float(x), float(z) - self.level]}
        return entries | ({"body": self.bodies[self.body[cell]]} if len(self.bodies) > 1 else {})

    def spacing(self) -> float:
        """Return the smallest distance of nodes [m]."""
        corners = self.mesh.points[self.mesh.cells]
        points = Basis.of_order(self.order).points
        shortest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).min()
        return float(0.5 * (points[1] - points[0]) * shortest)

    def gmsh(self) -> str | None:
        """Return the text of the Gmsh file (format 2.2); None where ruptfx makes the mesh."""
        if self.plates:
            return None
        lines = self.facets()
        for span, members in self.spans.items():
            lines[span] = np.concatenate([lines.pop(member) for member in members])
        if self.fault:
            both = np.concatenate([self.mesh.sides[tag] for tag in self.fault])
            lines["main"] = np.unique(np.sort(both, axis=1), axis=0)
        text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(self.bodies) + len(lines))]
        text += [f'2 {number} "{name}"' for number, name in enumerate(self.bodies, start=1)]
        text += [f'1 {number} "{name}"' for number, name in enumerate(lines, start=len(self.bodies) + 1)]
        text += ["$EndPhysicalNames", "$Nodes", str(len(self.mesh.points))]
        text += [f"{n} {x:.16g} {z:.16g} 0" for n, (x, z) in enumerate(self.mesh.points.tolist(), start=1)]
        elements = [(1, number, pair) for number, pairs in enumerate(lines.values(), start=len(self.bodies) + 1)
                    for pair in (pairs + 1).tolist()]  # fmt: skip
        elements += [
            (3, body, cell) for body, cell in zip((self.body + 1).tolist(), (self.mesh.cells + 1).tolist(), strict=True)
        ]
        text += ["$EndNodes", "$Elements", str(len(elements))]
        for n, (kind, group, vertices) in enumerate(elements, start=1):
            text.append(f"{n} {kind} 2 {group} {group} {' '.join(map(str, vertices))}")
        return "\n".join([*text, "$EndElements", ""])


def arrange(
    value: Input, mesh: Mesh, media: dict[int, Medium], fault: tuple[int, ...], order: int, viscous_apart: bool = False
) -> Layout:
    """Name the bodies of a mesh, and choose how the case makes it.

    With `viscous_apart`, viscous cells are bodies of their own.

    Raises
    ------
    ConversionError
        A tag has no material, or half a model is no box of squares with one material.
    """
    missing = [int(tag) for tag in np.unique(mesh.tags) if tag not in media]
    if missing:
        raise ConversionError(f"&MATERIAL tag = {missing[0]}: is required, because elements of the mesh have this tag")
    sides = _sides(mesh, fault)
    items = [media[int(tag)] for tag in np.unique(mesh.tags)]
    tables = [(medium.table, viscous_apart and medium.viscosity is not None) for medium in items]
    different = [number for number, table in enumerate(tables) if table not in tables[:number]]
    kind_of = {int(tag): tables.index(table) for tag, table in zip(np.unique(mesh.tags), tables, strict=True)}
    kind = np.array([different.index(kind_of[int(tag)]) for tag in np.unique(mesh.tags)])
    kind = kind[np.searchsorted(np.unique(mesh.tags), mesh.tags)]
    names = np.unique(sides).tolist()
    bodies: list[str] = []
    body = np.zeros(len(mesh.cells), dtype=np.int64)
    for side in names:
        kinds = np.unique(kind[sides == side])
        for each in kinds:
            body[(sides == side) & (kind == each)] = len(bodies)
            bodies.append(side if len(kinds) == 1 else f"{side}_{each + 1}")
    is_complete = len(bodies) == len(names) and mesh.square > 0
    plates = bool(fault) and is_complete and (len(fault) == 1 or 2 * mesh.cut == mesh.rows.max() + 1)
    layout = Layout(mesh, bodies, body, order, fault, plates)
    if len(fault) == 1 and (fault != (1,) or not plates):
        raise ConversionError(
            f"&BC_DEF tag = {fault[0]}: a fault on an edge is half of a symmetric model, which must be a box of square "
            "elements of one material above the fault; convert the whole model, with a fault inside"
        )
    if plates and layout.level:
        value.note(f"the fault at z = {layout.level:g} m is y = 0 here")
    return layout


def _sides(mesh: Mesh, fault: tuple[int, ...]) -> NDArray[np.str_]:
    """Return the first part of the name of the body of each cell."""
    if not fault:
        return np.full(len(mesh.cells), "body", dtype="<U8")
    if len(mesh.rows):
        return np.where(mesh.rows < mesh.cut, "lower", "upper").astype("<U8")
    sides = np.full(len(mesh.cells), "body", dtype="<U8")
    for name, tag in zip(("minus", "plus"), fault, strict=False):
        if tag in mesh.sides:
            sides[mesh.touching(tag)] = name
    return sides
