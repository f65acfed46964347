"""A mesh file with named bodies and interfaces: .geo and .msh of Gmsh, or any format that meshio reads."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field
from scipy.spatial import cKDTree

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, MeshSource, RawMesh, _geo
from ruptfx.bodies.meshes._cut import Facets, places
from ruptfx.input.schema import CasePath, Name, OwnJsonSchema, Part
from ruptfx.input.units import Positive
from ruptfx.platform.files import require_file
from ruptfx.platform.launch import ends_with_parent

if TYPE_CHECKING:
    from meshio import Mesh

# meshio name, DOLFINx name, nodes in DOLFINx order, facet name
_CELLS = [
    ("hexahedron", "hexahedron", [0, 1, 3, 2, 4, 5, 7, 6], "quad"),
    ("tetra", "tetrahedron", [0, 1, 2, 3], "triangle"),
    ("quad9", "quadrilateral", [0, 1, 3, 2, 4, 7, 5, 6, 8], "line3"),
    ("quad", "quadrilateral", [0, 1, 3, 2], "line"),
    ("triangle", "triangle", [0, 1, 2], "line"),
]
_DIMENSION = {"hexahedron": 3, "tetra": 3, "quad9": 2, "quad": 2, "triangle": 2, "line3": 1, "line": 1}

MOST_BYTES = 50_000_000_000  # largest size of a mesh file
FLAT = 1e-6  # of the extent: largest range of z of a plane mesh
SECONDS = 600.0  # time limit of Gmsh for a script
AGAIN = "write it again with Gmsh, or whatever made it"

OneOrMore = Annotated[
    list[str], Field(min_length=1), BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
    OwnJsonSchema({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}),
]  # fmt: skip
"""Names of bodies, or the name of one."""


class Sides(Part):
    """Bodies on either side of an interface, one or several; its normal points from minus to plus."""

    plus: OneOrMore
    """Body or bodies on the side that the normal points to."""
    minus: OneOrMore
    """Body or bodies on the other side."""
    matching: bool = True
    """True if the nodes of both sides coincide; else the interface needs `[faults.NAME.sliding]`."""


class GmshFile(MeshSource):
    """A mesh file whose physical groups name the bodies, the interfaces and the edges.

    Bodies that share nodes are welded, except along the interfaces: there they are cut apart, and where an interface
    ends inside they stay connected. The two sides of an interface may also have their own nodes at equal positions, or,
    with `matching = false`, at different positions.
    Other named lines on the boundary of a body become edges, under the name they have in the file. Where two
    interfaces follow each other, the point they share belongs to the one that is listed first, with the area of both.
    Where one ends on another that goes on (a branch), its last node is welded; where two cross, the halves of one need
    two names. Quadrilaterals of nine nodes (`Mesh.ElementOrder = 2`) follow curved
    outlines with parabolas.
    """

    example: ClassVar[str] = (
        '{ kind = "gmsh_file", file = "two_bodies.geo", interfaces = { main = { plus = "upper", minus = "lower" } } }'
    )

    file: CasePath
    """Mesh of Gmsh (`.msh`) or of a format that meshio reads, or a `.geo` script that Gmsh meshes."""
    interfaces: dict[Name, Sides] = {}
    """Bodies on the sides of each interface, by name of the physical group."""
    scale: Positive = 1.0
    """Metres per length unit of the file."""
    trust: bool = False
    """Allow a .geo file to run commands, write files and read outside of its directory, with your permissions."""

    def files(self) -> list[Path]:
        path = Path(self.file)
        return [path, *_geo.sources(path)] if path.suffix == ".geo" and path.is_file() else [path]

    def build(self) -> RawMesh:
        points, cell, cells, bodies, cell_body, named, middle = _read(Path(self.file), self.trust)
        dim = 3 if cell in ("hexahedron", "tetrahedron") else 2
        if dim == 2 and points.shape[1] == 3 and np.ptp(points[:, 2]) > FLAT * np.ptp(points, axis=0).max():
            low, high = points[:, 2].min(), points[:, 2].max()
            raise RuptfxError(
                f"{self.file}: the elements are not in the plane x-y, z is {low:.6g} to {high:.6g}; exchange y and z "
                "of its points"
            )
        points = points[:, :dim] * self.scale
        for name, sides in self.interfaces.items():
            _check_names(self.file, name, sides, named, bodies)
        known = Facets(cells, FACETS[cell])
        numbers = {name: known.find(facets) for name, facets in named.items()}
        found = {name: known.cells[number] for name, number in numbers.items()}  # [-1] where there is none
        for name, number in numbers.items():
            found[name][number < 0] = -1
        cuts = [np.zeros(0, dtype=int), *(numbers[name][found[name][:, 1] >= 0] for name in self.interfaces)]
        cut_cells, origin = known.cut(np.concatenate(cuts))
        raw = RawMesh(cell, np.concatenate([points, points[origin]]), cut_cells, bodies, cell_body)

        def on(facets: np.ndarray, cell: np.ndarray) -> np.ndarray:
            """Facets by the vertices that their cells have now."""
            return np.take_along_axis(cut_cells[cell], places(cells[cell], facets), axis=1)

        for name, sides in self.interfaces.items():
            raw.interfaces[name] = self._interface(raw, name, sides, named.pop(name), found[name], on)
        for name, facets in named.items():
            if self._is_edge(raw, name, found[name], facets):
                raw.edges[name] = on(facets, found[name][:, 0])
        return _curved(raw, middle[..., :dim] * self.scale) if middle.shape[1] else raw

    def _interface(
        self, raw: RawMesh, name: str, sides: Sides, facets: np.ndarray, cells: np.ndarray, on: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return facets of both sides, in the same order vertex by vertex if they match."""
        side_of = np.zeros(len(raw.bodies) + 1, dtype=int)  # the last: no body
        side_of[[raw.bodies.index(body) for body in sides.plus]] = 1
        side_of[[raw.bodies.index(body) for body in sides.minus]] = -1
        body = np.where(cells >= 0, raw.cell_body[cells], -1)
        side = side_of[body]
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
        own_plus, own_minus = (on(facets[alone & which], cells[alone & which, 0]) for which in (first, ~first))
        _check_sides(self.file, name, len(plus) + len(own_plus), len(minus) + len(own_minus))
        if not sides.matching:
            raw.non_matching.add(name)
        elif alone.any() or not len(facets):
            own_minus = _partners(self.file, name, raw.points, own_plus, own_minus)
        return np.concatenate([plus, own_plus]), np.concatenate([minus, own_minus])

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


def _curved(raw: RawMesh, middle: np.ndarray) -> RawMesh:
    """Return second-order cells: with a node on every side, duplicated at cuts, and one inside.

    Parameters
    ----------
    raw : RawMesh
        Mesh of the vertices.
    middle : ndarray, shape (cells, 5, 2)
        Coordinates of these nodes, in the order of DOLFINx [m].
    """
    sides = np.sort(raw.cells[:, FACETS[raw.cell]], axis=2).reshape(-1, 2)
    different, first, number = np.unique(sides, axis=0, return_index=True, return_inverse=True)
    on_sides = len(raw.points) + number.reshape(-1, 4)
    inside = len(raw.points) + len(different) + np.arange(len(raw.cells))[:, None]
    points = np.concatenate([raw.points, middle[:, :4].reshape(-1, 2)[first], middle[:, 4]])
    return replace(raw, points=points, cells=np.concatenate([raw.cells, on_sides, inside], axis=1), order=2)


def _place(raw: RawMesh, facet: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in raw.points[facet].mean(axis=0)) + ") m"


def _check_names(file: str, name: str, sides: Sides, named: dict[str, np.ndarray], bodies: list[str]) -> None:
    if name not in named:
        found = ", ".join(sorted(named)) or "none"
        raise RuptfxError(f"{file}: no interface '{name}' among the named facets; it has: {found}")
    plus, minus = sides.plus, sides.minus
    for side in (*plus, *minus):
        if side not in bodies:
            raise RuptfxError(f"{file}: interface '{name}': no body '{side}'; the file has: {', '.join(bodies)}")
    if set(plus) & set(minus):
        raise RuptfxError(
            f"{file}: interface '{name}': no body can be on both sides, plus ({', '.join(plus)}) and minus "
            f"({', '.join(minus)}); name each in one of them"
        )


def _check_sides(file: str, name: str, plus: int, minus: int) -> None:
    if not plus or not minus:
        raise RuptfxError(
            f"{file}: interface '{name}' has {plus} facets on its plus and {minus} on its minus side; name those of "
            "both"
        )


def _partners(file: str, name: str, points: np.ndarray, plus: np.ndarray, minus: np.ndarray) -> np.ndarray:
    """Return the minus facets in the order of the plus facets; refuse nodes that do not coincide."""
    minus_nodes, plus_nodes = np.unique(minus), np.unique(plus)
    distance, nearest = cKDTree(points[minus_nodes]).query(points[plus_nodes])
    size = np.linalg.norm(points[plus[:, 1]] - points[plus[:, 0]], axis=1).min()
    unmatched = int(np.sum(distance > 1e-6 * size))
    if unmatched or len(plus_nodes) != len(minus_nodes):
        raise RuptfxError(
            f"{file}: interface '{name}': the nodes of the two sides do not match ({len(plus_nodes)} on the plus, "
            f"{len(minus_nodes)} on the minus side, {unmatched} without a partner); mesh both sides alike, or let it "
            f"slide: matching = false here, and the table [faults.{name}.sliding]"
        )
    partner = np.zeros(len(points), dtype=np.int64)
    partner[plus_nodes] = minus_nodes[nearest]
    return partner[plus]


def _read(path: Path, trust: bool) -> tuple[Any, ...]:
    """Return vertices, cell type, cells, names of bodies, body of every cell, named facets, other nodes of cells."""
    import meshio

    try:
        require_file(path, MOST_BYTES, "mesh files", "mesh.file is relative to the case file, or absolute")
    except ValueError as error:
        raise RuptfxError(str(error)) from None
    if path.suffix == ".geo" and not trust:
        _geo.check(path)
    try:
        with redirect_stdout(io.StringIO()):  # meshio prints empty lines, and errors that are raised below
            if path.suffix == ".geo":
                with tempfile.TemporaryDirectory() as folder:
                    mesh = meshio.read(_generate(path, Path(folder), trust))
            else:
                mesh = meshio.read(path)
    except RuptfxError:
        raise
    except (Exception, SystemExit) as error:  # meshio raises many kinds of errors for damaged files
        raise RuptfxError(f"{path}: not a mesh that can be read ({error!s:.200}); {AGAIN}") from None
    _check_whole(path, mesh)
    kinds = {block.type for block in mesh.cells}
    known = [entry for entry in _CELLS if entry[0] in kinds]
    if not known:
        found = ", ".join(sorted(kinds))
        raise RuptfxError(
            f"{path}: no linear quadrilaterals, triangles, hexahedra or tetrahedra, and no quadrilaterals of nine "
            f"nodes; it has: {found}"
        )
    type_, cell, order, facet = known[0]
    mixed = "triangle" if cell == "quadrilateral" else "tetra" if cell == "hexahedron" else None
    if mixed and any(kind.startswith(mixed) for kind in kinds):
        raise RuptfxError(f"{path}: mixes cell types ({', '.join(sorted(kinds))}); mesh it with one")
    groups = _groups(mesh, type_)
    if not groups:
        raise RuptfxError(
            f"{path}: no physical groups; name the bodies and the interface (Physical Surface, Physical Curve)"
        )
    all_nodes, bodies = mesh.cells_dict[type_][:, order].astype(np.int64), sorted(groups)
    all_cells, others = np.split(all_nodes, [1 + max(map(max, FACETS[cell]))], axis=1)
    times = np.bincount(np.concatenate(list(groups.values())), minlength=len(all_cells))
    for wrong, what in ((times == 0, "no named body"), (times > 1, "more than one named body")):
        if wrong.any():
            raise RuptfxError(f"{path}: {wrong.sum()} cells belong to {what}; it has: {', '.join(bodies)}")
    cell_body = np.zeros(len(all_cells), dtype=np.int64)
    for number, name in enumerate(bodies):
        cell_body[groups[name]] = number
    used, cells = np.unique(all_cells, return_inverse=True)
    renumber = np.full(len(mesh.points), -1)
    renumber[used] = np.arange(len(used))
    facets = mesh.cells_dict.get(facet, np.zeros((0, 2), dtype=np.int64))[:, : len(FACETS[cell][0])]
    named = {name: renumber[np.unique(facets[chosen], axis=0)] for name, chosen in _groups(mesh, facet).items()}
    return mesh.points[used], cell, cells.reshape(all_cells.shape), bodies, cell_body, named, mesh.points[others]


def _check_whole(path: Path, mesh: Mesh) -> None:
    """Refuse a mesh with undefined points, or points without finite coordinates."""
    count = len(mesh.points)
    if np.ndim(mesh.points) != 2:
        raise RuptfxError(f"{path}: damaged: it has no points; {AGAIN}")
    for block in mesh.cells:
        nodes = np.asarray(block.data)
        wrong = nodes[(nodes < 0) | (nodes >= count)]
        if len(wrong):
            raise RuptfxError(f"{path}: damaged: a {block.type} has the point {wrong[0]}, of {count}; {AGAIN}")
    bad = ~np.isfinite(mesh.points).all(axis=1)
    if bad.any():
        raise RuptfxError(f"{path}: damaged: point {np.argmax(bad)} is at {mesh.points[np.argmax(bad)]}; {AGAIN}")


def _groups(mesh: Mesh, type_: str) -> dict[str, np.ndarray]:
    """Return elements of one type by the names of their physical groups; an element may have several."""
    names = {name: int(number) for name, (number, dim) in mesh.field_data.items() if dim == _DIMENSION[type_]}
    first = mesh.cell_data_dict.get("gmsh:physical", {}).get(type_, np.zeros(0))
    found = {}
    for name, number in names.items():
        chosen = np.flatnonzero(first == number)  # formats that store one group per element
        if name in mesh.cell_sets:
            chosen = mesh.cell_sets_dict[name].get(type_, chosen)
        if len(chosen):
            found[name] = np.asarray(chosen, dtype=np.int64)
    return found


@contextmanager
def _ended_by_a_signal(path: Path) -> Iterator[None]:
    """Raise an error at SIGTERM, so that the process of Gmsh ends and its folder is removed."""

    def stop(number: int, _: object) -> None:
        raise RuptfxError(f"{path}: ended by {signal.Signals(number).name} while Gmsh meshed it; nothing was written")

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not the main thread, which signals interrupt
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _generate(path: Path, folder: Path, trust: bool) -> Path:
    """Mesh a script in a separate process with a time limit.

    The process works in `folder`, as options of Gmsh may write files; with a trusted script in the current directory.

    Raises
    ------
    RuptfxError
        Gmsh cannot mesh it, or takes too long.
    """
    mesh, script = folder / "generated.msh", path.absolute()
    if not path.read_bytes().endswith(b"\n"):
        # Of a last line without an end Gmsh runs the first statement only, unless another script includes the file.
        script = folder / "script.geo"
        script.write_text(f'Include "{path.absolute()}";\n')
        options = path.with_name(path.name + ".opt")
        if options.is_file():
            script.with_name(script.name + ".opt").write_bytes(options.read_bytes() + b"\n")
    here = os.getcwd() if trust else str(folder)
    command = [sys.executable, "-m", "ruptfx.bodies.meshes._gmsh", str(script), str(mesh), here]
    try:
        with _ended_by_a_signal(path):
            done = subprocess.run(
                command, timeout=SECONDS, check=False, text=True, errors="replace", stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, preexec_fn=ends_with_parent(),
            )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise RuptfxError(
            f"{path}: Gmsh took longer than {SECONDS:g} s; coarsen the mesh, or mesh it with Gmsh yourself and give "
            "the file (.msh) in its place"
        ) from None
    if done.returncode or not mesh.is_file():
        said = done.stderr.strip() or f"it ended with code {done.returncode}"
        raise RuptfxError(f"{path}: Gmsh could not mesh it: {said}; open it in Gmsh to see where")
    return mesh
