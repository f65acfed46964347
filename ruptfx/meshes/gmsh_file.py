"""A mesh file with named bodies and interfaces: .geo and .msh of Gmsh, or anything meshio reads."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from ruptfx import RuptfxError
from ruptfx.meshes import MeshSource, RawMesh
from ruptfx.schema import CasePath, Name, Part
from ruptfx.units import Positive

# meshio name, DOLFINx name, vertices in DOLFINx order, facet name
_CELLS = [
    ("hexahedron", "hexahedron", [0, 1, 3, 2, 4, 5, 7, 6], "quad"),
    ("tetra", "tetrahedron", [0, 1, 2, 3], "triangle"),
    ("quad", "quadrilateral", [0, 1, 3, 2], "line"),
    ("triangle", "triangle", [0, 1, 2], "line"),
]


class Sides(Part):
    """Which bodies an interface separates; its normal points from minus to plus."""

    plus: str
    minus: str


class GmshFile(MeshSource):
    """A mesh file whose physical groups name the bodies, the interfaces and the edges.

    The two bodies of an interface may share its nodes (they are split here) or have their own at the same places.
    Other named lines become edges, under the name they have in the file.
    """

    file: CasePath
    interfaces: Annotated[dict[Name, Sides], Field(min_length=1)]
    scale: Positive = 1.0
    """Metres per length unit of the file."""

    def build(self) -> RawMesh:
        points, cell, cells, facets, names, cell_group, facet_group = _read(Path(self.file))
        dim = 3 if cell in ("hexahedron", "tetrahedron") else 2
        points = points[:, :dim] * self.scale
        bodies = sorted({names[g] for g in np.unique(cell_group) if g in names})
        body_of = {g: bodies.index(name) for g, name in names.items() if name in bodies}
        loose = [g for g in np.unique(cell_group) if g not in body_of]
        if loose:
            raise RuptfxError(f"{self.file}: {np.isin(cell_group, loose).sum()} cells belong to no named body")
        cell_body = np.array([body_of[g] for g in cell_group])
        named = {names[g]: facets[facet_group == g] for g in np.unique(facet_group) if g in names}
        raw = RawMesh(cell, points, cells, bodies, cell_body, {}, {})
        for name, sides in self.interfaces.items():
            _check_names(str(self.file), name, sides, named, bodies)
            raw.interfaces[name] = self._split(
                raw, name, named.pop(name), bodies.index(sides.plus), bodies.index(sides.minus)
            )
        raw.edges = {name: _on_body(raw, found) for name, found in named.items()}
        return raw

    def _split(
        self, raw: RawMesh, name: str, facets: np.ndarray, plus: int, minus: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Give the minus body its own nodes along the interface; facets of both sides, vertex by vertex."""
        on_plus = np.isin(facets, raw.cells[raw.cell_body == plus]).all(axis=1)
        on_minus = np.isin(facets, raw.cells[raw.cell_body == minus]).all(axis=1)
        if np.any(~on_plus & ~on_minus):
            raise RuptfxError(f"{self.file}: interface '{name}' has facets on neither of its bodies")
        if on_plus.all() and on_minus.all():
            shared = np.unique(facets)
            copy = np.arange(len(raw.points) + len(shared))
            copy[shared] = np.arange(len(raw.points), len(raw.points) + len(shared))
            raw.points = np.concatenate([raw.points, raw.points[shared]])
            own = raw.cell_body == minus
            raw.cells[own] = copy[raw.cells[own]]
            return facets, copy[facets]
        plus_facets, minus_facets = facets[on_plus & ~on_minus], facets[on_minus & ~on_plus]
        return plus_facets, _partners(str(self.file), name, raw.points, plus_facets, minus_facets)


def _check_names(file: str, name: str, sides: Sides, named: dict[str, np.ndarray], bodies: list[str]) -> None:
    if name not in named:
        found = ", ".join(sorted(named)) or "none"
        raise RuptfxError(f"{file}: no interface '{name}' among the named facets; it has: {found}")
    for side in (sides.plus, sides.minus):
        if side not in bodies:
            raise RuptfxError(f"{file}: interface '{name}': no body '{side}'; the file has: {', '.join(bodies)}")


def _partners(file: str, name: str, points: np.ndarray, plus: np.ndarray, minus: np.ndarray) -> np.ndarray:
    """The minus facets in the order of the plus facets, when the nodes coincide."""
    if len(plus) == 0 or len(minus) == 0:
        raise RuptfxError(
            f"{file}: interface '{name}' has {len(plus)} facets on its plus and {len(minus)} on its minus side"
        )
    minus_nodes, plus_nodes = np.unique(minus), np.unique(plus)
    distance, nearest = cKDTree(points[minus_nodes]).query(points[plus_nodes])
    size = np.linalg.norm(points[plus[:, 1]] - points[plus[:, 0]], axis=1).min()
    unmatched = int(np.sum(distance > 1e-6 * size))
    if unmatched or len(plus_nodes) != len(minus_nodes):
        raise RuptfxError(
            f"{file}: interface '{name}': the nodes of the two sides do not match ({len(plus_nodes)} on the plus, "
            f"{len(minus_nodes)} on the minus side, {unmatched} without a partner); mesh both sides alike"
        )
    partner = np.zeros(len(points), dtype=np.int64)
    partner[plus_nodes] = minus_nodes[nearest]
    return partner[plus]


def _on_body(raw: RawMesh, facets: np.ndarray) -> np.ndarray:
    """Facets by the nodes their cells have now: a corner node may have been replaced by its copy."""
    copies: dict[tuple[float, ...], list[int]] = {}
    for vertex in np.unique(raw.cells):
        copies.setdefault(tuple(np.round(raw.points[vertex], 12)), []).append(int(vertex))
    pairs = {frozenset(facet) for facet in _all_facets(raw)}
    found = []
    for facet in facets:
        choices: list[list[int]] = [[]]
        for vertex in facet:
            same = copies.get(tuple(np.round(raw.points[vertex], 12)), [int(vertex)])
            choices = [[*chosen, other] for chosen in choices for other in same]
        found += [next((c for c in choices if frozenset(c) in pairs), [int(v) for v in facet])]
    return np.array(found, dtype=np.int64)


def _all_facets(raw: RawMesh) -> list[tuple[int, ...]]:
    from ruptfx.bodies import FACETS

    return [tuple(row) for facet in FACETS[raw.cell] for row in raw.cells[:, list(facet)].tolist()]


def _read(path: Path) -> tuple[Any, ...]:
    """Points, cell type, cells and facets with their groups, and the names of the groups."""
    import meshio

    if not path.exists():
        raise RuptfxError(f"{path}: no such mesh file")
    try:
        if path.suffix == ".geo":
            with tempfile.TemporaryDirectory() as folder:
                mesh = meshio.read(_generate(path, Path(folder)))
        else:
            mesh = meshio.read(path)
    except (meshio.ReadError, OSError, SystemExit) as error:
        raise RuptfxError(f"{path}: not a mesh that can be read: {error}") from None
    kinds = {block.type for block in mesh.cells}
    known = [entry for entry in _CELLS if entry[0] in kinds]
    if not known:
        found = ", ".join(sorted(kinds))
        raise RuptfxError(f"{path}: no linear quadrilaterals, triangles, hexahedra or tetrahedra; it has: {found}")
    type_, cell, order, facet = known[0]
    if (cell == "quadrilateral" and "triangle" in kinds) or (cell == "hexahedron" and "tetra" in kinds):
        raise RuptfxError(f"{path}: mixes cell types ({', '.join(sorted(kinds))}); mesh it with one")
    groups = mesh.cell_data_dict.get("gmsh:physical", {})
    if type_ not in groups:
        raise RuptfxError(
            f"{path}: no physical groups; name the bodies and the interface (Physical Surface, Physical Curve)"
        )
    names = {int(number): name for name, (number, dim) in mesh.field_data.items()}
    facets = mesh.cells_dict.get(facet, np.zeros((0, 2), dtype=np.int64)).astype(np.int64)
    cells = mesh.cells_dict[type_][:, order].astype(np.int64)
    used, cells = np.unique(cells, return_inverse=True)
    renumber = np.full(len(mesh.points), -1)
    renumber[used] = np.arange(len(used))
    facet_group = groups.get(facet, np.zeros(0))
    return mesh.points[used], cell, cells.reshape(-1, len(order)), renumber[facets], names, groups[type_], facet_group


def _generate(path: Path, folder: Path) -> Path:
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        gmsh.model.mesh.generate(3 if gmsh.model.getEntities(3) else 2)
        gmsh.write(str(folder / "generated.msh"))
    except Exception as error:
        raise RuptfxError(f"{path}: Gmsh could not mesh it: {error}") from None
    finally:
        gmsh.finalize()
    return folder / "generated.msh"
