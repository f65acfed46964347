"""Cells, points and named groups of a mesh file, read by meshio, or by Gmsh in a separate process."""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, _geo, _gmsh
from ruptfx.input.schema import closest
from ruptfx.platform.files import require_file
from ruptfx.platform.launch import ends_with_parent

if TYPE_CHECKING:
    from meshio import Mesh

# meshio name, DOLFINx name, nodes in DOLFINx order, facet name
_CELLS = [
    ("hexahedron27", "hexahedron", [0, 1, 3, 2, 4, 5, 7, 6, 8, 11, 16, 9, 17, 10, 19, 18, 12, 15, 13, 14,
                                    24, 22, 20, 21, 23, 25, 26], "quad9"),
    ("hexahedron", "hexahedron", [0, 1, 3, 2, 4, 5, 7, 6], "quad"),
    ("tetra", "tetrahedron", [0, 1, 2, 3], "triangle"),
    ("quad9", "quadrilateral", [0, 1, 3, 2, 4, 7, 5, 6, 8], "line3"),
    ("quad", "quadrilateral", [0, 1, 3, 2], "line"),
    ("triangle", "triangle", [0, 1, 2], "line"),
]  # fmt: skip
_DIMENSION = {
    "hexahedron27": 3, "hexahedron": 3, "tetra": 3, "quad9": 2, "quad": 2, "triangle": 2, "line3": 1, "line": 1
}  # fmt: skip
_BY_GMSH = {".geo", ".med", ".unv"}  # formats whose groups meshio does not return; .msh where meshio fails
_OF_GMSH = re.compile(rb"\s*\$(?!MeshFormat\s+2)")  # begin of mesh files that Gmsh may read where meshio fails: not 2.2
_REFERENCES = {".xdmf": rb"([^\s<>\"]+\.h5):", ".inp": rb"(?im)^\*include\b.*?=[ \t]*([^\s,]+)"}  # names of other files
_CODED = re.compile(r"#\d (\d+) (.*)", re.S)  # dimension, number and name of a group, by `_gmsh.name_groups`
_EXODUS = {".e", ".ex2", ".exo"}

MOST_BYTES = 50_000_000_000  # largest size of a mesh file
SECONDS = 600.0  # time limit of Gmsh for a script
AGAIN = "write it again with Gmsh, or whatever made it"
FORMATS = "write it as .msh, .med, .unv or .inp with named groups of bodies and of facets"


class FileMesh(NamedTuple):
    """A mesh as it is in a file, with the names that a case uses.

    Attributes
    ----------
    points : ndarray, shape (vertices, 2 or 3)
        In units of the file.
    cell : str
        DOLFINx name.
    cells : ndarray of int, shape (cells, vertices per cell)
    bodies : list of str
    cell_body : ndarray of int, shape (cells,)
    facets : dict of str to ndarray of int, shape (facets, vertices per facet)
        Facets of every named group.
    middle : ndarray, shape (cells, other nodes, 2 or 3)
        Coordinates of the nodes of every cell that are no vertices.
    """

    points: np.ndarray
    cell: str
    cells: np.ndarray
    bodies: list[str]
    cell_body: np.ndarray
    facets: dict[str, np.ndarray]
    middle: np.ndarray


class _Group(NamedTuple):
    """A group of elements; its name is its number if it has no other."""

    name: str
    number: int | None
    elements: np.ndarray

    def shown(self) -> str:
        """Return the name as a value of a TOML key."""
        return self.name if self.name == str(self.number) else f'"{self.name}"'


def sources(path: Path) -> list[Path]:
    """Return the existing files that meshio reads with a mesh file: arrays of XDMF, parts of Abaqus."""
    if path.suffix not in _REFERENCES or not path.is_file():
        return []
    names = re.findall(_REFERENCES[path.suffix], path.read_bytes())
    files = dict.fromkeys(path.absolute().parent / os.fsdecode(name) for name in names)
    return [file for file in files if file.is_file()]


def read(path: Path, trust: bool, sides: Mapping[str, list[str]], names: Mapping[str, str | int]) -> FileMesh:
    """Read a mesh file.

    Parameters
    ----------
    trust : bool
        Scripts may do more than describe a geometry.
    sides : dict of str to list of str
        Bodies on both sides of every interface of the case.
    names : dict of str to str or int
        Names or numbers of groups in the file, by the names of the case.

    Raises
    ------
    RuptfxError
        Names the file, and the group or the element.
    """
    mesh = _load(path, trust)
    _check_whole(path, mesh)
    kinds = {block.type for block in mesh.cells}
    known = [entry for entry in _CELLS if entry[0] in kinds]
    if not known:
        raise RuptfxError(
            f"{path}: no linear quadrilaterals, triangles, hexahedra or tetrahedra, and no quadrilaterals of nine or "
            f"hexahedra of 27 nodes; it has: {', '.join(sorted(kinds)) or 'no elements'}; write it with elements of "
            "first order (Mesh.ElementOrder = 1), or with all nodes of those (Mesh.SecondOrderIncomplete = 0)"
        )
    type_, cell, order, facet = known[0]
    mixed = "triangle" if cell == "quadrilateral" else "tetra" if cell == "hexahedron" else None
    if mixed and any(kind.startswith(mixed) for kind in kinds):
        raise RuptfxError(f"{path}: mixes cell types ({', '.join(sorted(kinds))}); mesh it with one")
    groups, of_facets = _groups(path, mesh, type_), _groups(path, mesh, facet)
    if not groups:
        lost = [name for name in mesh.field_data if not _CODED.fullmatch(name)]
        raise RuptfxError(
            f"{path}: no physical groups with {type_} elements; "
            + (
                f"it has names ({', '.join(lost)}) without elements, as Gmsh writes in version 2.2 with "
                "Mesh.SaveAll = 1; write it with Mesh.SaveAll = 0, or in version 4.1" if lost
                else "name the bodies and the interface (Physical Surface, Physical Curve); formats other than that of "
                "Gmsh need sets of elements, or one integer number of every element; sets of nodes and sides of "
                "elements are not read"
            )
        )  # fmt: skip
    groups, of_facets = _named(path, groups, of_facets, sides, names, mesh.point_sets)
    all_nodes, elements = _distinct(mesh.cells_dict[type_][:, order].astype(np.int64), groups)
    all_cells, others = np.split(all_nodes, [1 + max(map(max, FACETS[cell]))], axis=1)
    named = {*names, *(body for side in sides.values() for body in side)}
    elements = _without_containers(elements, named, len(all_cells))
    cell_body, bodies = _bodies(path, elements, mesh.points, all_cells), sorted(elements)
    used, cells = np.unique(all_cells, return_inverse=True)
    renumber = np.full(len(mesh.points), -1)
    renumber[used] = np.arange(len(used))
    nodes = mesh.cells_dict.get(facet, np.zeros((0, 2), dtype=np.int64))[:, : len(FACETS[cell][0])]
    facets = {group.name: renumber[np.unique(nodes[group.elements], axis=0)] for group in of_facets}
    return FileMesh(mesh.points[used], cell, cells.reshape(all_cells.shape), bodies, cell_body, facets,
                    mesh.points[others])  # fmt: skip


def _load(path: Path, trust: bool) -> Mesh:  # noqa: C901
    """Return the mesh as meshio has it; of files that meshio cannot read, as Gmsh writes it again."""
    import meshio

    try:
        require_file(path, MOST_BYTES, "mesh files", "mesh.file is relative to the case file, or absolute")
    except ValueError as error:
        raise RuptfxError(str(error)) from None
    if path.suffix in _EXODUS:
        raise RuptfxError(f"{path}: names of blocks and sides in Exodus files are not read; {FORMATS}")
    if path.suffix == ".geo":
        if not trust:
            _geo.check(path)
        _geo.check_ends(path)
    if path.suffix == ".inp" and (count := len(re.findall(rb"(?im)^\*node[ \t\r]*(?:,|$)", path.read_bytes()))) > 1:
        raise RuptfxError(
            f"{path}: has {count} blocks *NODE, of which meshio reads the last only; write one for all parts (Abaqus: "
            "Edit Model Attributes, Do not use parts and assemblies in input files)"
        )
    reason, said = "", io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):  # meshio prints empty lines, and errors that are raised below
        if path.suffix not in _BY_GMSH:
            try:
                mesh = meshio.gmsh.read(path) if path.suffix == ".msh" else meshio.read(path)
            except (Exception, SystemExit) as error:  # meshio raises many kinds of errors for damaged files
                text = " ".join(said.getvalue().split()) if isinstance(error, SystemExit) else str(error)
                reason = text[:200] or type(error).__name__
                if isinstance(error, UnicodeDecodeError):
                    reason = "a name of a group is not in UTF-8, unless it is damaged; save it as UTF-8"
                if path.suffix != ".msh" or not _OF_GMSH.match(_head(path)):
                    remedy = AGAIN if path.suffix == ".msh" else FORMATS
                    raise RuptfxError(f"{path}: not a mesh that can be read ({reason}); {remedy}") from None
            else:
                if path.suffix != ".msh" or not _has_numbers(mesh):
                    return mesh
        with tempfile.TemporaryDirectory() as folder:
            try:
                return meshio.gmsh.read(_by_gmsh(path, Path(folder), trust, reason))
            except RuptfxError:
                raise
            except (Exception, SystemExit) as error:
                raise RuptfxError(f"{path}: not a mesh that can be read ({error!s:.200}); {AGAIN}") from None


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(64)


def _has_numbers(mesh: Mesh) -> bool:
    """Return whether an element is in a group that has no name."""
    known = [number for number, _ in mesh.field_data.values()]
    return any(np.setdiff1d(tags, [0, *known]).size for tags in mesh.cell_data.get("gmsh:physical", []))


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


# -- groups ----------------------------------------------------------------------------------------------------------


def _groups(path: Path, mesh: Mesh, type_: str) -> list[_Group]:
    """Return the groups with elements of one type; an element may be in several."""
    groups: list[_Group] = []
    sets = mesh.cell_sets_dict
    if mesh.field_data:  # of Gmsh
        first = mesh.cell_data_dict.get("gmsh:physical", {}).get(type_, np.zeros(0))
        for key, (number, dim) in mesh.field_data.items():
            coded = _CODED.fullmatch(key)
            name = coded[2] or coded[1] if coded else key
            if dim == _DIMENSION[type_] and not (coded and coded[1] == "0"):
                chosen = sets[key].get(type_, []) if key in mesh.cell_sets else np.flatnonzero(first == number)
                groups.append(_Group(name, int(number), np.asarray(chosen, dtype=np.int64)))
    elif named := {name: of for name, of in sets.items() if not name.startswith("gmsh:")}:
        groups = [_Group(name, None, np.asarray(of.get(type_, []), dtype=np.int64)) for name, of in named.items()]
    else:
        numbers = _numbers(path, mesh).get(type_, np.zeros(0, dtype=int))
        groups = [_Group(str(each), int(each), np.flatnonzero(numbers == each)) for each in np.unique(numbers)]
        groups = [group for group in groups if group.number is not None and group.number >= 0]
    return [group for group in groups if len(group.elements)]


def _numbers(path: Path, mesh: Mesh) -> dict[str, np.ndarray]:
    """Return the group number of every element, by type, of formats that have no names."""
    kinds = {
        key: data for key, data in mesh.cell_data_dict.items()
        if key != "gmsh:geometrical" and all(np.ndim(of) == 1 and of.dtype.kind in "iu" for of in data.values())
    }  # fmt: skip
    if "gmsh:physical" in kinds:  # zero is no group
        return {type_: np.where(of == 0, -1, of) for type_, of in kinds["gmsh:physical"].items()}
    if len(kinds) > 1:
        raise RuptfxError(f"{path}: which numbers of elements are groups? It has: {', '.join(kinds)}; keep one of them")
    return next(iter(kinds.values()), {})


def _named(
    path: Path, cells: list[_Group], facets: list[_Group], sides: Mapping[str, list[str]],
    names: Mapping[str, str | int], of_nodes: Collection[str],
) -> tuple[list[_Group], list[_Group]]:  # fmt: skip
    """Return groups of bodies and of facets with the names of the case.

    A name of an interface or with a dot is that of facets, the sides of interfaces are bodies; another is that of
    a body if the file has one.
    """
    on_sides = {body for side in sides.values() for body in side}
    groups, new = {"body": cells, "facets": facets}, dict[tuple[str, int], str]()
    known = sorted({group.shown() for group in (*cells, *facets)})
    for key, value in sorted(names.items(), key=lambda item: item[0] not in {*sides, *on_sides} and "." not in item[0]):
        kinds = ("facets",) if key in sides or "." in key else ("body",) if key in on_sides else ("body", "facets")
        places = [
            (kind, place) for kind in kinds for place, group in enumerate(groups[kind])
            if value in ((group.number,) if isinstance(value, int) else (group.name,))
        ]  # fmt: skip
        free = [place for place in places if place not in new]
        if not free:
            what = " or ".join("a group of facets" if kind == "facets" else "a body" for kind in kinds)
            if places:
                raise RuptfxError(f"{path}: mesh.names.{key} = {value!r}: '{new[places[0]]}' is this group; keep one")
            close = closest(str(value), [group.name for kind in kinds for group in groups[kind]])
            raise RuptfxError(
                f"{path}: mesh.names.{key} = {value!r}: is not {what}; "
                + (f"did you mean '{close}'?" if close else f"it has: {', '.join(known)}")
            )
        new[free[0]] = key
    for kind, of_kind in groups.items():
        groups[kind] = [
            group._replace(name=new.get((kind, place), group.name)) for place, group in enumerate(of_kind)
        ]  # fmt: skip
        for place, group in enumerate(of_kind):
            if (kind, place) not in new and group.name in {name for (of, _), name in new.items() if of == kind}:
                raise RuptfxError(
                    f"{path}: mesh.names.{group.name} = {names[group.name]!r}: another group has this name; give that "
                    "one another name in mesh.names, too"
                )
    _check_names(path, groups, sides, names, of_nodes)
    return _united(groups["body"]), _united(groups["facets"])


def _united(groups: list[_Group]) -> list[_Group]:
    """Return one group for all of equal name."""
    by_name: dict[str, _Group] = {}
    for group in groups:
        if group.name in by_name:
            group = group._replace(elements=np.union1d(by_name[group.name].elements, group.elements))
        by_name[group.name] = group
    return list(by_name.values())


def _check_names(
    path: Path, groups: Mapping[str, list[_Group]], sides: Mapping[str, list[str]], names: Mapping[str, str | int],
    of_nodes: Collection[str],
) -> None:  # fmt: skip
    """Refuse interfaces and bodies that the file does not have, and propose their groups."""
    wanted = {"facets": list(sides), "body": list(dict.fromkeys(body for side in sides.values() for body in side))}
    texts, proposal = [], dict[str, str]()
    for kind, keys in wanted.items():
        free = {group.name: group.shown() for group in groups[kind] if group.name not in {*keys, *names}}
        present = ", ".join(sorted(group.name for group in groups[kind])) or "none"
        for key in keys:
            if any(group.name == key for group in groups[kind]):
                continue
            texts.append(
                f"no interface '{key}' among the named facets; it has: {present}" if kind == "facets"
                else f"no body '{key}'; the file has: {present}"
            )  # fmt: skip
            if key in of_nodes:
                texts.append(f"'{key}' is a set of nodes, which are not read: name the elements there")
                continue
            if free:
                # Names that no case can have are those that need another one.
                first = min(free, key=lambda name: (re.fullmatch(r"[A-Za-z]\w*(\.\w+)*", name, re.A) is not None, name))
                proposal[key] = free.pop(closest(key, list(free)) or first)
    if texts:
        text = ", ".join(f"{key} = {shown}" for key, shown in proposal.items())
        remedy = f"; correct the case, or say in [mesh] which group is meant, as names = {{ {text} }}" if text else (
            "; name them in the file: bodies are groups of cells, interfaces groups of facets (Physical Curve in 2D, "
            "Physical Surface in 3D)"
        )  # fmt: skip
        raise RuptfxError(f"{path}: {'; '.join(texts)}{remedy}")


def _distinct(cells: np.ndarray, groups: list[_Group]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return cells without repetitions, and those of every group; some formats repeat a cell for each of its groups."""
    mixed = (np.sort(cells, axis=1) * np.random.default_rng(0).integers(1, 2**62, cells.shape[1])).sum(axis=1)
    if len(np.unique(mixed)) == len(cells):  # sums of integers, modulo 2**64
        return cells, {group.name: group.elements for group in groups}
    _, first, number = np.unique(np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True)
    return cells[first], {group.name: np.unique(number.ravel()[group.elements]) for group in groups}


def _without_containers(elements: dict[str, np.ndarray], used: Collection[str], count: int) -> dict[str, np.ndarray]:
    """Return the groups of cells but for those that the case does not name inside of those that it names."""
    covered = np.zeros(count, dtype=bool)
    for name in elements.keys() & used:
        covered[elements[name]] = True
    return {name: cells for name, cells in elements.items() if name in used or not covered[cells].all()}


def _bodies(path: Path, elements: Mapping[str, np.ndarray], points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the number of the body of every cell, in alphabetical order; refuse cells of none and of several."""
    names = sorted(elements)
    times = np.bincount(np.concatenate([elements[name] for name in names]), minlength=len(cells))
    for wrong, what in ((times == 0, "no named body"), (times > 1, "more than one named body")):
        if wrong.any():
            first = int(np.argmax(wrong))
            place = ", ".join(f"{x:.6g}" for x in points[cells[first]].mean(axis=0))
            among = [name for name in names if first in elements[name]]
            raise RuptfxError(
                f"{path}: {wrong.sum()} cells belong to {what}, the first at ({place})"
                + (" in " + " and ".join(f"'{name}'" for name in among)) * bool(among)
                + f"; it has: {', '.join(names)}; "
                + (
                    f"list in [mesh] the bodies that count, as names = {{ {among[0]} = \"{among[0]}\" }}; a group that "
                    "lies inside of them is then ignored" if among else "give these cells to a group, or remove them"
                )
            )  # fmt: skip
    cell_body = np.zeros(len(cells), dtype=np.int64)
    for number, name in enumerate(names):
        cell_body[elements[name]] = number
    return cell_body


# -- Gmsh ------------------------------------------------------------------------------------------------------------


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


def _by_gmsh(path: Path, folder: Path, trust: bool, reason: str) -> Path:
    """Mesh a script, or read a mesh, in a separate process with a time limit; return the mesh that it writes.

    The process works in `folder`, as options of Gmsh may write files; with a trusted script in the current directory.

    Raises
    ------
    RuptfxError
        Gmsh cannot mesh or read it, or takes too long.
    """
    mesh, script = folder / "generated.msh", path.absolute()
    options = path.with_name(path.name + ".opt")
    if path.suffix != ".geo":  # Gmsh runs a file of options beside the mesh: there is none in the folder
        script = folder / f"mesh{path.suffix}"
        script.symlink_to(path.absolute())
    elif not (_geo.is_ended(path) and _geo.is_ended(options)):
        # Gmsh runs only the first statement of a last line without an end, unless another script includes the file.
        script = folder / "script.geo"
        script.write_text(f'Include "{path.absolute()}";\n')
        if options.is_file():
            script.with_name(script.name + ".opt").write_bytes(options.read_bytes() + b"\n")
    place = os.getcwd() if trust else str(folder)
    command = [sys.executable, "-P", str(_gmsh.__file__), str(script), str(mesh), place]  # starts without this package
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
        said = " ".join(done.stderr.replace(str(script), str(path)).split())
        said = said or f"it ended with code {done.returncode}"
        if path.suffix == ".geo":
            raise RuptfxError(f"{path}: Gmsh could not mesh it: {said}; open it in Gmsh to see where")
        raise RuptfxError(
            f"{path}: not a mesh that can be read ({f'meshio: {reason}; ' * bool(reason)}Gmsh: {said:.200}); {AGAIN}"
        )
    return mesh
