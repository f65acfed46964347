"""Mesh files as other people write them: versions, formats, numbers, names, planes and rounded coordinates."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import slip_weakening

pytest.importorskip("gmsh")
pytest.importorskip("meshio")

import meshio

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import RawMesh
from ruptfx.bodies.meshes._gmsh import session
from ruptfx.bodies.meshes.gmsh_file import GmshFile
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError

PLATES = (Path(__file__).parents[1] / "data" / "two_bodies.geo").read_text()
SIDES = {"main": {"plus": "upper", "minus": "lower"}}
NAMES = {"lower": 1, "upper": 3, "main": 103, "upper.left": 105, "upper.top": 3, "lower.bottom": 1}


def write(path: Path, script: str = PLATES, parts: int = 0, **options: float) -> Path:
    """Mesh a script and write it with options of the table Mesh; the format is that of the suffix."""
    source = path.with_name("source.geo")
    source.write_text(script + "\n")
    with session() as gmsh:
        gmsh.open(str(source))
        gmsh.model.mesh.generate(3 if gmsh.model.getEntities(3) else 2)
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        if parts:
            gmsh.model.mesh.partition(parts)
        gmsh.write(str(path))
    source.unlink()
    return path


def numbered(script: str = PLATES) -> str:
    """Return the script with numbers in the place of names; surfaces and curves share two of them."""
    for name, number in NAMES.items():
        script = script.replace(f'("{name}")', f"({number})")
    return script


def build(path: Path, interfaces: Any = SIDES, **keys: Any) -> RawMesh:
    return GmshFile(file=str(path), interfaces=interfaces, **keys).build()


def assert_plates(raw: RawMesh) -> None:
    """Two plates of 40 x 10 mm with 20 facets of 2 mm along the interface, and three edges, whatever the file."""
    assert raw.bodies == ["lower", "upper"] and len(raw.cells) == 496
    assert {name: len(facets) for name, facets in raw.edges.items()} == {
        "upper.left": 5, "upper.top": 20, "lower.bottom": 20
    }  # fmt: skip
    x, y = raw.points[np.concatenate(raw.interfaces["main"])].reshape(-1, 2).T
    assert len(raw.interfaces["main"][0]) == 20 and np.all(y == 0) and np.ptp(x) == pytest.approx(40e-3, rel=1e-14)
    corners = raw.points[raw.cells]
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    assert np.bincount(raw.cell_body, areas) == pytest.approx(400e-6, rel=1e-12)
    assert np.all(corners[raw.cell_body == 1][..., 1] >= 0) and np.all(corners[raw.cell_body == 0][..., 1] <= 0)


WRITTEN: dict[str, tuple[str, dict[str, Any]]] = {
    "4.1": ("a.msh", {}),
    "4.1 SaveAll": ("a.msh", {"SaveAll": 1}),
    "4.1 SaveAll binary": ("a.msh", {"SaveAll": 1, "Binary": 1}),
    "4.1 partitioned": ("a.msh", {"parts": 3}),
    "4.1 partitioned with borders": ("a.msh", {"parts": 3, "PartitionCreateTopology": 1}),
    "4.0": ("a.msh", {"MshFileVersion": 4.0}),
    "2.2": ("a.msh", {"MshFileVersion": 2.2}),
    "2.2 partitioned": ("a.msh", {"MshFileVersion": 2.2, "parts": 3}),
    "UNV": ("a.unv", {}),
    "MED": ("a.med", {}),
    "Abaqus": ("a.inp", {"SaveGroupsOfElements": 1}),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_every_format_with_names(how: str, tmp_path: Path) -> None:
    name, options = WRITTEN[how]
    try:
        path = write(tmp_path / name, **options)
    except Exception as error:
        if f"compiled with {how} support" in str(error):
            pytest.skip(f"this Gmsh has no {how}")
        raise
    assert_plates(build(path))


@pytest.mark.parametrize("version", [1.0, 2.2, 4.0, 4.1])
def test_numbered_groups(version: float, tmp_path: Path) -> None:
    """The numbers 1 and 3 are those of a surface and of a curve."""
    path = write(tmp_path / "a.msh", numbered(), MshFileVersion=version)
    assert_plates(build(path, names=NAMES))
    with pytest.raises(RuptfxError, match=facts(
        r"a\.msh: .* 'main' .* 1, 103, 105, 3; no body 'upper'; .* 1, 3; no body 'lower'; .* 1, 3; .*names = \{"
    )) as refused:  # fmt: skip
        build(path)
    proposal = tomllib.loads(str(refused.value)[str(refused.value).index("names = {") :])["names"]
    assert proposal.keys() == {"main", "upper", "lower"} and {proposal["upper"], proposal["lower"]} == {1, 3}


@pytest.mark.parametrize("suffix", ["vtu", "xdmf", "vtk"])
def test_formats_with_numbers_of_elements(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """meshio keeps the numbers of groups in these formats, and drops their names."""
    monkeypatch.chdir(tmp_path)
    mesh = meshio.gmsh.read(write(tmp_path / "a.msh", numbered(), MshFileVersion=2.2))
    meshio.write(tmp_path / f"a.{suffix}", meshio.Mesh(mesh.points, mesh.cells, cell_data=mesh.cell_data))
    assert_plates(build(tmp_path / f"a.{suffix}", names=NAMES))
    data = {"rock": mesh.cell_data["gmsh:physical"], "zone": mesh.cell_data["gmsh:physical"]}
    meshio.write(tmp_path / f"b.{suffix}", meshio.Mesh(mesh.points, mesh.cells, cell_data=data))
    with pytest.raises(RuptfxError, match=facts(rf"b\.{suffix}: .*rock, zone; keep one")):
        build(tmp_path / f"b.{suffix}", names=NAMES)


def test_names_that_no_case_has(tmp_path: Path) -> None:
    """Blanks, digits first, hyphens and umlauts are mapped; the message has the table to paste."""
    script = PLATES.replace('"main"', '"main fault"')
    script = script.replace('"lower"', '"2nd-Platte"').replace('"upper"', '"Obere Fläche"')
    path = write(tmp_path / "a.msh", script)
    assert_plates(build(path, names={"lower": "2nd-Platte", "upper": "Obere Fläche", "main": "main fault"}))
    with pytest.raises(CaseError, match=facts(r"'main fault' .*names = \{ main_fault = \"main fault\" \}")):
        build(path, {"main fault": SIDES["main"]})
    with pytest.raises(RuptfxError) as refused:
        build(path)
    text = str(refused.value)
    names = tomllib.loads(text[text.index("names = {") :])["names"]
    assert names["main"] == "main fault" and {names["upper"], names["lower"]} == {"Obere Fläche", "2nd-Platte"}


MAPPINGS: list[tuple[dict[str, Any], str]] = [
    ({"upper": "uper"}, r"mesh\.names\.upper = 'uper': .* 'upper'"),
    ({"main": 4711}, r"mesh\.names\.main = 4711: .*it has: "),
    ({"upper": "main"}, r"mesh\.names\.upper = 'main': "),
    ({"upper": "lower"}, r"no body 'lower'; the file has: upper, upper|another group has this name"),
    ({"a.b": "main", "c.d": "main"}, r"mesh\.names\.c\.d = 'main': 'a\.b'"),
    ({"upper": 1.5}, r"names\.upper = 1\.5: "),
    ({"upper": {"left": 105}}, r"names\.upper: .*quotation marks"),
    ({"upper": True}, r"names\.upper = True: "),
]  # fmt: skip


@pytest.mark.parametrize("names, message", MAPPINGS)
def test_mappings_that_are_refused(names: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.msh")
    with pytest.raises(RuptfxError, match=facts(message)):
        build(path, names=names)


def test_names_may_be_exchanged(tmp_path: Path) -> None:
    raw = build(write(tmp_path / "a.msh"), names={"upper": "lower", "lower": "upper"})
    assert np.all(raw.points[raw.cells][raw.cell_body == raw.bodies.index("upper")][..., 1] <= 0)


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_cells_in_two_groups(version: float, tmp_path: Path) -> None:
    """A group that lies inside of the bodies that the case names is ignored; else all is said that mends it."""
    both = PLATES + '\nPhysical Surface("rock") = {1, 2};\nPhysical Curve("outside") = {1, 6, 7};'
    path = write(tmp_path / "a.msh", both, MshFileVersion=version)
    assert_plates(build(path))
    message = r"a\.msh: 496 cells .*'lower' and 'rock'; .*: lower, rock, upper; .*names = \{"
    with pytest.raises(RuptfxError, match=facts(message)):
        build(path, {})
    assert build(path, {}, names={"lower": "lower", "upper": "upper"}).bodies == ["lower", "upper"]
    assert build(path, {}, names={"whole": "rock"}).bodies == ["whole"]


def test_cells_of_no_group(tmp_path: Path) -> None:
    """Of a file with all elements, none is dropped without a word."""
    path = write(tmp_path / "a.msh", PLATES.replace('Physical Surface("lower") = {1};', ""), SaveAll=1)
    with pytest.raises(RuptfxError, match=facts(r"a\.msh: \d+ cells belong to no named body, .*; it has: upper; ")):
        build(path, {})


def test_an_edge_with_a_number_is_proposed(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.bodies.space.bodies import distribute
    from ruptfx.platform import fem

    script = PLATES.replace('("upper.left")', "(105)")
    path = write(tmp_path / "a.msh", script)
    mesh = GmshFile.model_validate({"file": str(path), "interfaces": SIDES})
    bodies = distribute(fem.MPI.COMM_SELF, mesh)
    with pytest.raises(RuptfxError, match=facts(r"edge = 'upper\.left': .*names = \{ \"upper\.left\" = 105 \}")):
        bodies.tag("upper.left", "edge")


def test_lost_groups_of_version_2(tmp_path: Path) -> None:
    path = write(tmp_path / "a.msh", MshFileVersion=2.2, SaveAll=1)
    with pytest.raises(RuptfxError, match=facts(r"a\.msh: .*main, .*2\.2 .*Mesh\.SaveAll = 1; .*Mesh\.SaveAll = 0")):
        build(path)


@pytest.mark.parametrize("axis", ["{1, 0, 0}", "{0, 1, 0}"])
def test_planes_other_than_x_y(axis: str, tmp_path: Path) -> None:
    """Turned by 90 degrees about x into x-z, and about y into y-z; the coordinate that was z keeps its order."""
    turn = "Rotate {%s, {0, 0, 0}, Pi / 2} { Surface{1, 2}; }"
    raw = build(write(tmp_path / "a.msh", f"{PLATES}\n{turn % axis}"))
    assert len(raw.cells) == 496 and raw.points.shape[1] == 2
    assert sorted(np.ptp(raw.points, axis=0)) == pytest.approx([20e-3, 40e-3], rel=1e-9)
    with pytest.raises(RuptfxError, match=facts(r"a\.msh: .* x-y, x-z and y-z: x .*, z .* to .*; ")):
        build(write(tmp_path / "a.msh", f"{PLATES}\n{(turn % axis).replace('/ 2', '/ 3')}"))


OWN = PLATES.replace("Curve Loop(2) = {-3, 5, 6, 7}", "Point(7) = {40e-3, 0, 0, h}; Point(8) = {0, 0, 0, h}; "
    "Line(8) = {7, 8}; Line(15) = {7, 5}; Line(17) = {6, 8}; Curve Loop(2) = {-8, 15, 6, 17}").replace(
    "Line(5) = {3, 5}; ", "").replace(" Line(7) = {6, 4};", "").replace("= {3};", "= {3, 8};").replace(
    '("upper.left") = {7}', '("upper.left") = {17}')  # fmt: skip


def sides_apart(path: Path, order: int, apart: float) -> None:
    """Write two plates with their own nodes, the upper one moved up [m]."""
    write(path, OWN + "\nRecombine Surface{1, 2};" * (order == 2), MshFileVersion=2.2)
    if order == 2:
        with session() as gmsh:
            gmsh.merge(str(path))
            gmsh.model.mesh.setOrder(2)
            gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
            gmsh.write(str(path))
    mesh = meshio.gmsh.read(path)
    upper = np.unique(np.concatenate([
        block.data[tags == mesh.field_data["upper"][0]].ravel() for block, tags in
        zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True) if block.type[:4] in ("quad", "tria")
    ]))  # fmt: skip
    mesh.points[upper, 1] += apart
    meshio.write(path, mesh, file_format="gmsh22", binary=False)


@pytest.mark.parametrize("order", [1, 2])
def test_one_tolerance_for_split_nodes(order: int, tmp_path: Path) -> None:
    """Facets are 2 mm long; nodes of both sides are closer than 1e-4 of it, and equal afterwards, those between too."""
    sides_apart(tmp_path / "a.msh", order, 1.8e-7)
    raw = build(tmp_path / "a.msh")
    plus, minus = raw.interfaces["main"]
    assert raw.order == order and not np.intersect1d(plus, minus).size
    assert np.array_equal(raw.points[plus], raw.points[minus])
    assert np.sum(np.abs(raw.points[:, 1] - 1.8e-7) < 1e-12) == 2 * (21 + 20 * (order - 1))


@pytest.mark.parametrize("order", [1, 2])
def test_split_nodes_beyond_the_tolerance(order: int, tmp_path: Path) -> None:
    sides_apart(tmp_path / "a.msh", order, 2.2e-7)
    message = r"a\.msh: interface 'main': .*\(21 .*, 21 .*, 21 .* 2\.2e-07 m .* 0\.0001"
    with pytest.raises(RuptfxError, match=facts(message)):
        build(tmp_path / "a.msh")


def test_bodies_that_coincide_to_nine_digits(tmp_path: Path) -> None:
    """Without a name between them, nodes 0.9e-4 of a side apart are duplicates for the check, too."""
    from ruptfx.bodies.space.connections import check_connections

    path = write(tmp_path / "a.msh", OWN)
    raw = build(path)
    plus = raw.points[raw.cells[raw.cell_body == 1]]
    assert plus[..., 1].min() == 0
    raw.points[np.unique(raw.cells[raw.cell_body == 1]), 1] += 0.5e-4 * 1e-3
    raw.interfaces.clear()
    with pytest.raises(RuptfxError, match=facts(r"'lower' and 'upper' .* 21 nodes")):
        check_connections(raw, [])


@pytest.mark.parametrize("kind, common", [("quadrilateral", 2), ("hexahedron", 4)])
def test_cells_with_one_side_in_common_coincide(kind: str, common: int) -> None:
    """One cell on another, each with nodes of its own; at one corner alone, or two in 3D, they only touch."""
    from ruptfx.bodies.meshes import RawMesh
    from ruptfx.bodies.space.connections import check_connections

    cube = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    cell = cube[:, [0, 2, 1]] if kind == "hexahedron" else cube[:4, :2]
    for away, coincides in ((np.zeros(cell.shape[1]), True), (np.eye(cell.shape[1])[0], False)):
        points = np.concatenate([cell, cell + np.eye(cell.shape[1])[1] + away])
        raw = RawMesh(kind, points, np.arange(2 * len(cell)).reshape(2, -1), ["a", "b"], np.array([0, 1]))
        if coincides:
            with pytest.raises(RuptfxError, match=facts(rf"'a' and 'b' .* {common} nodes")):
                check_connections(raw, [])
        else:
            check_connections(raw, [])


@pytest.mark.parametrize("version", [4.0, 4.1])
def test_what_gmsh_reads_in_part_is_refused(version: float, tmp_path: Path) -> None:
    path = write(tmp_path / "a.msh", MshFileVersion=version)
    whole = path.read_bytes()
    for part in (0.2, 0.5, 0.9):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(RuptfxError, match=facts(r"a\.msh: .*Gmsh: ")):
            build(path)


def test_no_file_of_options_is_run_beside_a_mesh(tmp_path: Path) -> None:
    path = write(tmp_path / "a.msh", MshFileVersion=4.0)
    (tmp_path / "a.msh.opt").write_text(f'SystemCall "touch {tmp_path}/hit";\n')
    assert_plates(build(path))
    assert not (tmp_path / "hit").exists()


def test_sets_of_nodes_and_parts_of_abaqus_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.inp", SaveGroupsOfElements=1)
    text = path.read_text()
    path.write_text(text.replace("*ELSET,ELSET=main", "*NSET,NSET=main"))
    with pytest.raises(RuptfxError, match=facts(r"a\.inp: no interface 'main' .*; 'main' .* nodes, .*")):
        build(path)
    path.write_text(text.replace("*NODE\n", "*NODE, NSET=all\n") + "*Node\n1, 0, 0, 0\n")
    with pytest.raises(RuptfxError, match=facts(r"a\.inp: has 2 blocks \*NODE")):
        build(path)


@pytest.mark.parametrize("version", [2.2, 4.1, 0])
def test_names_that_are_not_in_utf_8(version: float, tmp_path: Path) -> None:
    script = PLATES.replace('"lower"', '"Flaeche"')
    path = tmp_path / "a.geo"
    path.write_text(script)
    if version:
        path = write(tmp_path / "a.msh", script, MshFileVersion=version)
    path.write_bytes(path.read_bytes().replace(b"Flaeche", "Fl\u00e4che".encode("latin-1")))
    with pytest.raises(RuptfxError, match=facts(r"a\.\w+: .*UTF-8")):
        build(path)


def test_files_that_a_mesh_file_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A resumed run compares them, too: the arrays of XDMF, and the nodes of Abaqus in a file of their own."""
    monkeypatch.chdir(tmp_path)
    mesh = meshio.gmsh.read(write(tmp_path / "a.msh", MshFileVersion=2.2))
    meshio.write(tmp_path / "a.xdmf", meshio.Mesh(mesh.points, mesh.cells))
    arrays = GmshFile.model_validate({"file": str(tmp_path / "a.xdmf")}).files()
    assert arrays == [tmp_path / "a.xdmf", tmp_path / "a.h5"]
    (tmp_path / "nodes.inp").write_text("*NODE\n1, 0, 0, 0\n")
    (tmp_path / "b.inp").write_text("*Include, input=nodes.inp\n*ELEMENT, TYPE=CPS4\n")
    assert GmshFile.model_validate({"file": str(tmp_path / "b.inp")}).files() == [
        tmp_path / "b.inp", tmp_path / "nodes.inp"
    ]  # fmt: skip


def test_exodus_is_refused_with_formats_that_work(tmp_path: Path) -> None:
    (tmp_path / "a.exo").write_bytes(b"CDF")
    with pytest.raises(RuptfxError, match=facts(r"a\.exo: .* \.msh, \.med, \.unv .* \.inp ")):
        build(tmp_path / "a.exo")


# -- interfaces inside one body ----------------------------------------------------------------------------------------

# A block of 8 x 4 mm, squares of 1 mm, in quarters; the line 11 from (0, 2) to (4, 2), 21 from there to (8, 2), 41 from
# there to (4, 4).
INSIDE = """
d = 1e-3;
For j In {0:2}
  For i In {0:2}
    Point(1 + i + 3 * j) = {4 * d * i, 2 * d * j, 0};
  EndFor
EndFor
For j In {0:2}
  Line(10 + j) = {1 + 3 * j, 2 + 3 * j}; Line(20 + j) = {2 + 3 * j, 3 + 3 * j};
EndFor
For i In {0:2}
  Line(30 + i) = {1 + i, 4 + i}; Line(40 + i) = {4 + i, 7 + i};
EndFor
Curve Loop(1) = {10, 31, -11, -30}; Curve Loop(2) = {20, 32, -21, -31};
Curve Loop(3) = {11, 41, -12, -40}; Curve Loop(4) = {21, 42, -22, -41};
For k In {1:4}
  Plane Surface(k) = {k};
EndFor
Transfinite Curve{10:12, 20:22} = 5; Transfinite Curve{30:32, 40:42} = 3;
Transfinite Surface{1:4}; Recombine Surface{1:4};
Physical Surface("rock") = {1, 2, 3, 4}; Physical Surface("below") = {1, 2}; Physical Surface("above") = {3, 4};
Physical Curve("left") = {11}; Physical Curve("right") = {21}; Physical Curve("whole") = {11, 21};
Physical Curve("corner") = {11, 41}; Physical Curve("junction") = {11, 21, 41}; Physical Curve("up") = {41};
Physical Curve("rock.top") = {12, 22}; Physical Curve("rock.bottom") = {10, 20};
"""
ROCK = {"plus": "rock", "minus": "rock", "normal": [0.2, 1.0]}


@pytest.mark.parametrize("fault", ["left", "right", "whole"])
def test_an_interface_inside_a_body_is_that_between_two(fault: str, tmp_path: Path) -> None:
    """It ends at the boundary and inside, with 4 nodes more than the 45 by hand, or at both boundaries, with 9 more."""
    path = write(tmp_path / "a.msh", INSIDE)
    one, two = build(path, {fault: ROCK}), build(path, {fault: {"plus": "above", "minus": "below"}})
    assert one.bodies == ["rock"] and two.bodies == ["above", "below"]
    assert np.array_equal(one.points, two.points) and np.array_equal(one.cells, two.cells)
    for side in (0, 1):
        assert np.array_equal(one.interfaces[fault][side], two.interfaces[fault][side])
    assert len(one.points) == 45 + (9 if fault == "whole" else 4)
    turned = build(path, {fault: ROCK | {"normal": [0.0, -1.0]}})
    assert np.array_equal(turned.interfaces[fault][0], one.interfaces[fault][1])


NO_SIDES: list[tuple[str, Any, str]] = [
    ("corner", [1.0, 0.0], r"'corner' at \(.*, 0\.002\) m .*normal = \[1\.0, 0\.0\]"),
    ("corner", [1.0, 1.0], r"'corner' .*\(0\.004, 0\.002\) m"),
    ("junction", [-0.3, 1.0], r"'junction' .*\(0\.004, 0\.002\) m"),
    ("left", [0.0, 0.0], r"left\.normal = \[0\.0, 0\.0\]"),
    ("left", [0.0, 0.0, 1.0], r"left\.normal = \[0\.0, 0\.0, 1\.0\]: .* 2 "),
    ("left", None, r"'left': .*rock .*normal = \[0\.0, 1\.0\]"),
]  # fmt: skip


@pytest.mark.parametrize("fault, normal, message", NO_SIDES)
def test_sides_that_are_ambiguous(fault: str, normal: Any, message: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.msh", INSIDE)
    with pytest.raises(RuptfxError, match=facts(message)):
        build(path, {fault: ROCK | {"normal": normal}})


def test_what_is_proposed_for_corners_and_junctions(tmp_path: Path) -> None:
    """A direction between both normals, and a branch with a name of its own."""
    path = write(tmp_path / "a.msh", INSIDE)
    plus, _ = build(path, {"corner": ROCK | {"normal": [-1.0, 1.0]}}).interfaces["corner"]
    assert len(plus) == 6
    raw = build(path, {"whole": ROCK, "up": ROCK | {"normal": [1.0, 0.0]}})
    assert [len(sides[0]) for sides in raw.interfaces.values()] == [8, 2]


SOLID = (
    INSIDE[: INSIDE.index("Physical Surface")]
    + """
For k In {1:4}
  e[] = Extrude {0, 0, 2 * d} { Surface{k}; Layers{2}; Recombine; };
  block~{k} = e[1]; upper~{k} = e[4];
EndFor
Coherence;
Physical Volume("rock") = {1, 2, 3, 4}; Physical Volume("below") = {1, 2}; Physical Volume("above") = {3, 4};
"""
)


def in_solids(script: str) -> str:
    """Return the script with groups of the surfaces that lie over the lines 11, 12 and 10."""
    return script + "\n".join(
        f'Physical Surface("{name}") = Surface In BoundingBox {{{box}}};' for name, box in {
            "left": "-1e-6, 2e-3 - 1e-6, -1e-6, 4e-3 + 1e-6, 2e-3 + 1e-6, 2e-3 + 1e-6",
            "whole.top": "-1e-6, 4e-3 - 1e-6, -1e-6, 8e-3 + 1e-6, 4e-3 + 1e-6, 2e-3 + 1e-6",
            "whole.bottom": "-1e-6, -1e-6, -1e-6, 8e-3 + 1e-6, 1e-6, 2e-3 + 1e-6",
        }.items()
    )  # fmt: skip


CASE = """
order = 2
duration = "6 us"
plane = "{plane}"
[materials.default]
kind = "isotropic_elastic"
young_modulus = "5.3 GPa"
poisson_ratio = 0.35
density = "1246 kg/m3"
[faults.left]
contact = {{ kind = "split_node" }}
friction = {{ kind = "linear_slip_weakening", mu_s = 0.3, mu_d = 0.1, D_c = "1 um" }}
initial_stress = {{ normal = "2 MPa", shear = "0.5 MPa" }}
[damping.kelvin_voigt]
fraction = 0.2
[[boundaries]]
kind = "driven"
edge = "{top}"
component = "x"
velocity = "4 m/s"
[[boundaries]]
kind = "driven"
edge = "{bottom}"
component = "x"
velocity = 0.0
[output]
figures = false
"""


def split(path: Path, raw: RawMesh) -> None:
    """Write a mesh whose two sides have nodes of their own, with the facets of both in the group of the interface."""
    cell, facet = ("quad", "line") if raw.cell == "quadrilateral" else ("hexahedron", "quad")
    numbers = {name: number for number, name in enumerate((*raw.bodies, *raw.interfaces, *raw.edges), 1)}
    facets = {name: np.concatenate(pair) for name, pair in raw.interfaces.items()} | raw.edges
    order = [0, 1, 3, 2] if cell == "quad" else [0, 1, 3, 2, 4, 5, 7, 6]
    tags = [raw.cell_body + 1, np.repeat([numbers[name] for name in facets], [len(each) for each in facets.values()])]
    meshio.write(path, meshio.Mesh(
        np.pad(raw.points, ((0, 0), (0, 3 - raw.points.shape[1]))),
        [(cell, raw.cells[:, order]), (facet, np.concatenate([*facets.values()]))],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([number, raw.points.shape[1] - (name not in raw.bodies)])
                    for name, number in numbers.items()},
    ), file_format="gmsh22", binary=False)  # fmt: skip


@pytest.mark.fem
@pytest.mark.parametrize("dim", [2, 3])
def test_numbers_inside_one_body_are_those_between_two(dim: int, tmp_path: Path) -> None:
    """The fault slips; the other half of its plane, and its rim, are welded in both meshes."""
    pytest.importorskip("dolfinx")
    from ruptfx import read_case, simulate

    write(tmp_path / "a.msh", INSIDE if dim == 2 else in_solids(SOLID))
    names = ("rock.top", "rock.bottom") if dim == 2 else ("whole.top", "whole.bottom")
    split(tmp_path / "split.msh", build(tmp_path / "a.msh", {"left": {"plus": "above", "minus": "below"}}))
    text = CASE.format(top=names[0], bottom=names[1], plane="strain" if dim == 2 else "solid")
    records = []
    for file, plus, minus in (("a", "rock", "rock"), ("a", "above", "below"), ("split", "above", "below")):
        sides = f'plus = "{plus}"\nminus = "{minus}"\n' + f"normal = {[0.1, 1.0, 0.0][:dim]}" * (plus == minus)
        case = tmp_path / f"{file}_{plus}.toml"
        case.write_text(f'{text}[mesh]\nkind = "gmsh_file"\nfile = "{file}.msh"\n[mesh.interfaces.left]\n{sides}\n')
        records.append(simulate(read_case(case), out=tmp_path / case.stem, progress=False).interface)
    one, *others = records
    fields = [name for name, field in one.data_vars.items() if field.dtype.kind == "f"]
    slips = [name for name in fields if name.startswith("slip") and "rate" not in name]
    assert max(np.abs(one[name].values).max() for name in slips) > 1e-6
    for name in fields:
        for other in others:
            scale = np.nanmax(np.abs(other[name].values), initial=0.0)
            np.testing.assert_allclose(one[name].values, other[name].values, rtol=0, atol=1e-12 * scale, err_msg=name)


EMBEDDED = {
    2: """
Point(1) = {0, 0, 0, 1}; Point(2) = {6, 0, 0, 1}; Point(3) = {6, 4, 0, 1}; Point(4) = {0, 4, 0, 1};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Point(5) = {2, 1.5, 0, 0.5}; Point(6) = {4, 2.5, 0, 0.5}; Line(5) = {5, 6};
Curve{5} In Surface{1};
Physical Surface("rock") = {1}; Physical Curve("fault") = {5};
""",
    3: """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 6, 4, 4};
Rectangle(20) = {2, 1, 0, 2, 2};
Rotate {{1, 0, 0}, {0, 2, 0}, Pi / 3} { Surface{20}; }
Translate {0, 0, 2} { Surface{20}; }
BooleanFragments{ Volume{1}; Delete; }{ Surface{20}; Delete; }
MeshSize{:} = 0.7;
Physical Volume("rock") = {1}; Physical Surface("fault") = {20};
""",
}


@pytest.mark.parametrize("dim", [2, 3])
def test_a_rim_inside_the_body_is_welded(dim: int, tmp_path: Path) -> None:
    """The sides share the nodes of the rim and no others; triangles of the plus side are above the fault."""
    path = write(tmp_path / "a.msh", EMBEDDED[dim])
    raw = build(path, {"fault": ROCK | {"normal": [0.0, 1.0] if dim == 2 else [0.0, 0.0, 1.0]}})
    plus, minus = raw.interfaces["fault"]
    ridges = np.sort(np.concatenate([np.delete(plus, i, axis=1) for i in range(dim)]), axis=1)
    once, count = np.unique(ridges, axis=0, return_counts=True)
    rim = np.unique(once[count == 1])
    assert np.array_equal(np.intersect1d(plus, minus), rim) and len(np.unique(plus)) > len(rim)
    assert np.array_equal(raw.points[plus], raw.points[minus])
    assert len(raw.points) == len(np.unique(raw.points, axis=0)) + len(np.unique(plus)) - len(rim)
    for side, sign in ((plus, 1), (minus, -1)):
        cells = [raw.cells[np.isin(raw.cells, facet).sum(axis=1) == dim] for facet in side]
        assert all(len(each) == 1 or np.isin(facet, rim).all() for each, facet in zip(cells, side, strict=True))
        apart = [raw.points[each[0]].mean(axis=0) - raw.points[facet].mean(axis=0)
                 for each, facet in zip(cells, side, strict=True) if len(each) == 1]  # fmt: skip
        slope = np.array([-0.5, 1.0]) if dim == 2 else np.array([0.0, -np.sqrt(3), 1.0])
        assert np.all(sign * (np.array(apart) @ slope) > 0)


def network(dim: int, shape: str) -> str:
    """Script of faults in triangles or tetrahedra of one body.

    `main` lies at y = 2 from x = 1 to 5, in 3D at z = 2 from y = 0.5 to 3.5; `other` at x = 3 crosses it or ends at it,
    in 3D from y = 1.25 to 2.75; of a fork the arms go up and down from x = 3.
    """
    low = 1.0 if shape == "crossing" else 2.0
    if dim == 3:
        return f"""
SetFactory("OpenCASCADE");
Box(1) = {{0, 0, 0, 6, 4, 4}};
Rectangle(20) = {{1, 0.5, 2, 4, 3}};
Rectangle(30) = {{0, 0, 0, {3 - low}, 1.5}};
Rotate {{{{0, 1, 0}}, {{0, 0, 0}}, -Pi / 2}} {{ Surface{{30}}; }}
Translate {{3, 1.25, {low}}} {{ Surface{{30}}; }}
BooleanFragments{{ Volume{{1}}; Delete; }}{{ Surface{{20, 30}}; Delete; }}
MeshSize{{:}} = 0.6;
Physical Volume("rock") = Volume{{:}};
Physical Surface("main") = Surface In BoundingBox {{0.9, 0.4, 1.9, 5.1, 3.6, 2.1}};
Physical Surface("other") = Surface In BoundingBox {{2.9, 1.2, 0.9, 3.1, 2.8, 3.1}};
"""
    ends = {
        "crossing": [(1, 2), (5, 2), (3, 1), (3, 3)], "branch": [(1, 2), (5, 2), (3, 3)],
        "fork": [(1, 2), (5, 3), (5, 1)], "boundary": [(0, 2), (6, 2), (3, 0), (3, 4)],
    }[shape]  # fmt: skip
    points = "".join(f"Point({5 + i}) = {{{x}, {y}, 0, 0.4}};" for i, (x, y) in enumerate([(3, 2), *ends]))
    arms = "".join(f"Line({10 + i}) = {{5, {6 + i}}};" for i in range(len(ends)))
    main, other = ("10", "11, 12") if shape == "fork" else ("10, 11", "12, 13" if len(ends) == 4 else "12")
    names = f'Physical Curve("main") = {{{main}}}; Physical Curve("other") = {{{other}}};'
    if shape == "boundary":
        return (
            f'SetFactory("OpenCASCADE"); Rectangle(1) = {{0, 0, 0, 6, 4}}; {points} {arms}'
            "BooleanFragments{ Surface{1}; Delete; }{ Curve{10:13}; Delete; } MeshSize{:} = 0.4;"
            'Physical Surface("rock") = Surface{:}; '
            'Physical Curve("main") = Curve In BoundingBox {-1, 1.9, -1, 7, 2.1, 1};'
            'Physical Curve("other") = Curve In BoundingBox {2.9, -1, -1, 3.1, 5, 1};'
        )
    corners = "Point(1) = {0, 0, 0, 1}; Point(2) = {6, 0, 0, 1}; Point(3) = {6, 4, 0, 1}; Point(4) = {0, 4, 0, 1};"
    frame = "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Curve Loop(1) = {1, 2, 3, 4};"
    inside = f"Plane Surface(1) = {{1}}; Curve{{{main}, {other}}} In Surface{{1}};"
    return f'{corners} {frame} {points} {arms} {inside} Physical Surface("rock") = {{1}}; {names}'


def wanted_copies(dim: int, shape: str, x: np.ndarray) -> int:
    """Number of nodes at a point, by hand: the parts in which the faults divide its surroundings."""
    eps = 1e-9
    if dim == 2:
        fork = shape == "fork"
        low, left, top = (0, 0, 4) if shape == "boundary" else (1, 1, 3)
        right = 6 - left
        if np.hypot(x[0] - 3, x[1] - 2) < eps:
            return {"crossing": 4, "branch": 3, "fork": 3, "boundary": 4}[shape]
        inside = 1 if shape != "boundary" else -1  # ends at the boundary are cut open
        on_main = abs(x[1] - 2) < eps and left + inside * eps < x[0] < (3 if fork else right - inside * eps)
        on_other = abs(x[0] - 3) < eps and (2 if shape == "branch" else low + inside * eps) < x[1] < top - inside * eps
        if fork:
            on_other = abs(abs(x[1] - 2) - (x[0] - 3) / 2) < eps and 3 < x[0] < 5 - eps
        return 2 if on_main or on_other else 1
    low = 1 if shape == "crossing" else 2
    on_main = abs(x[2] - 2) < eps and 1 + eps < x[0] < 5 - eps and 0.5 + eps < x[1] < 3.5 - eps
    on_other = abs(x[0] - 3) < eps and 1.25 + eps < x[1] < 2.75 - eps and low - eps < x[2] < 3 - eps
    if shape == "crossing":
        on_other &= x[2] > 1 + eps
    if on_main and on_other:
        return 4 if shape == "crossing" else 3
    return 2 if on_main or on_other else 1


@pytest.mark.parametrize("dim, shape", [
    (2, "crossing"), (2, "branch"), (2, "fork"), (2, "boundary"), (3, "crossing"), (3, "branch"),
])  # fmt: skip
def test_junctions_and_crossings_inside_one_body(dim: int, shape: str, tmp_path: Path) -> None:
    """Every point has as many nodes as parts around it, one at ends inside the body; sides follow the normal."""
    path = write(tmp_path / "a.msh", network(dim, shape))
    up = [0.0, 1.0] if dim == 2 else [0.0, 0.0, 1.0]
    normals = {"main": up, "other": [-1.0 if shape != "fork" else 1.0, *[0.0] * (dim - 1)]}
    if shape == "fork":
        path = write(tmp_path / "a.msh", network(dim, shape).replace('("other") = {11, 12}',
                     '("other") = {11}; Physical Curve("third") = {12}'))  # fmt: skip
        normals = {"main": up, "other": up, "third": up}
    raw = build(path, {name: ROCK | {"normal": normal} for name, normal in normals.items()})
    places, count = np.unique(raw.points.round(9), axis=0, return_counts=True)
    wanted = np.array([wanted_copies(dim, shape, x) for x in places])
    assert np.array_equal(count, wanted), places[count != wanted]
    assert {2, 3 if shape in ("branch", "fork") else 4} <= set(wanted.tolist())
    assert set(np.unique(raw.cells)) == set(range(len(raw.points)))
    beside = [set(np.flatnonzero((raw.cells == node).any(axis=1))) for node in range(len(raw.points))]
    for name, (plus, minus) in raw.interfaces.items():
        assert np.array_equal(raw.points[plus], raw.points[minus]) and len(plus) > 2
        for side, sign in ((plus, 1), (minus, -1)):
            for facet in side:
                cells = set.intersection(*(beside[node] for node in facet))
                middle = raw.points[facet].mean(axis=0)
                toward = [sign * (raw.points[raw.cells[cell]].mean(axis=0) - middle) @ normals[name] for cell in cells]
                assert max(toward) > 0 and (len(cells) == 1 or wanted_copies(dim, shape, raw.points[facet[0]]) == 1)


QUARTERS = {2: "Physical Surface", 3: "Physical Volume"}


@pytest.mark.fem
@pytest.mark.parametrize("shape, dim", [
    ("crossing", 2), pytest.param("crossing", 3, marks=pytest.mark.slow), ("junction", 2), ("junction", 3),
])  # fmt: skip
def test_slip_on_crossing_faults_inside_one_body_is_that_between_four(dim: int, shape: str, tmp_path: Path) -> None:
    """Bitwise the same mesh but for the names of bodies, and the same fields of both faults."""
    pytest.importorskip("dolfinx")
    from ruptfx import read_case, simulate

    quarters = "".join(f'{QUARTERS[dim]}("q{k}") = {{{k}}};' for k in range(1, 5))
    names = ["whole", "up", "down"] if shape == "crossing" else ["whole", "up"]  # halves of a crossing have two names
    if dim == 2:
        script = INSIDE + 'Physical Curve("down") = {31};' + quarters
    else:
        script = in_solids(SOLID) + quarters + "".join(
            f'Physical Surface("{name}") = Surface In BoundingBox {{{box}}};' for name, box in {
                "whole": "-1e-6, 2e-3 - 1e-6, -1e-6, 8e-3 + 1e-6, 2e-3 + 1e-6, 2e-3 + 1e-6",
                "up": "4e-3 - 1e-6, 2e-3 - 1e-6, -1e-6, 4e-3 + 1e-6, 4e-3 + 1e-6, 2e-3 + 1e-6",
                "down": "4e-3 - 1e-6, -1e-6, -1e-6, 4e-3 + 1e-6, 2e-3 + 1e-6, 2e-3 + 1e-6",
            }.items()
        )  # fmt: skip
    write(tmp_path / "a.msh", script)
    edges = ("rock.top", "rock.bottom") if dim == 2 else ("whole.top", "whole.bottom")
    text = CASE.format(top=edges[0], bottom=edges[1], plane="strain" if dim == 2 else "solid")
    begin, end = text.index("[faults.left]"), text.index("[damping")
    text = (
        text[:begin] + "".join(text[begin:end].replace("faults.left", f"faults.{each}") for each in names) + text[end:]
    )
    between = {"whole": (["q3", "q4"], ["q1", "q2"]), "up": (["q4"], ["q3"]), "down": (["q2"], ["q1"])}
    sides = {"one": {each: (["rock"], ["rock"]) for each in names}, "four": {each: between[each] for each in names}}
    records, meshes = [], []
    for name, of_faults in sides.items():
        tables = ""
        for each, (plus, minus) in of_faults.items():
            normal = ([0.1, 1.0, 0.0] if each == "whole" else [1.0, 0.1, 0.0])[:dim]
            tables += f"[mesh.interfaces.{each}]\nplus = {plus}\nminus = {minus}\n" + f"normal = {normal}\n" * (
                name == "one"
            )
        case = tmp_path / f"{name}.toml"
        case.write_text(f'{text}[mesh]\nkind = "gmsh_file"\nfile = "a.msh"\n{tables}')
        parsed = read_case(case)
        meshes.append(parsed.mesh.build())
        records.append(simulate(parsed, out=tmp_path / name, progress=False))
    one, four = meshes
    assert np.array_equal(one.points, four.points) and np.array_equal(one.cells, four.cells)
    around = (one.points[:, :2] == [4e-3, 2e-3]).all(axis=1).sum()
    assert around == (4 if shape == "crossing" else 3) * (1 if dim == 2 else 3)
    for each in sides["one"]:
        of_one, of_four = (record.interfaces[each] for record in records)
        assert np.abs(of_one["slip" if dim == 2 else "slip_1"].values).max() > 1e-8
        for name in (name for name, field in of_one.data_vars.items() if field.dtype.kind == "f"):
            np.testing.assert_array_equal(of_one[name].values, of_four[name].values, err_msg=f"{each}: {name}")


@pytest.mark.parametrize("dim, normal", [(2, [-0.5, 1.0]), (3, [0.0, 1.0, -0.58])])
def test_the_normal_that_is_proposed_is_accepted(dim: int, normal: list[float], tmp_path: Path) -> None:
    """The fault rises by 1 over 2 along x, and by 60 degrees over y."""
    path = write(tmp_path / "a.msh", EMBEDDED[dim])
    both = {"plus": "rock", "minus": "rock"}
    with pytest.raises(RuptfxError, match=facts(r"'fault': .*rock .*normal = \[")) as refused:
        build(path, {"fault": both})
    proposal = tomllib.loads(str(refused.value)[str(refused.value).index("normal = [") :])["normal"]
    assert proposal == normal
    assert len(build(path, {"fault": both | {"normal": proposal}}).interfaces["fault"][0])
    with pytest.raises(RuptfxError, match=facts(r"'fault' at .* normal = \[.*normal = \[")) as refused:
        build(path, {"fault": both | {"normal": [[1.0, 0.5], [1.0, 0.0, 0.0]][dim - 2]}})
    assert f"normal = {normal}" in str(refused.value)


def without_a_facet(path: Path) -> Path:
    """Leave out the line of a mesh in MSH 2.2 that lies between x = 10 and 12 mm of the interface."""
    lines = path.read_text().split("\n")
    names = {line.split()[2].strip('"'): line.split()[1] for line in lines if line.count('"') == 2}
    at = lines.index("$Nodes") + 2
    node = {p[0]: (float(p[1]), float(p[2])) for p in (line.split() for line in lines[at : at + int(lines[at - 1])])}
    at = lines.index("$Elements") + 2
    elements = range(at, at + int(lines[at - 1]))
    of = {at: lines[at].split() for at in elements if lines[at].split()[3] == names["main"]}
    middle = {at: sum(node[word][0] for word in words[-2:]) / 2 for at, words in of.items()}
    first = min(node[word][0] for words in of.values() for word in words[-2:])
    del lines[min(middle, key=lambda at: abs(middle[at] - first - 11e-3))]
    lines[at - 1] = str(len(elements) - 1)
    path.write_text("\n".join(lines))
    return path


def test_check_names_a_facet_that_is_missing(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.app.checks.preflight import preflight

    def missing(path: Path) -> list[Any]:
        table = slip_weakening({"mesh": {"kind": "gmsh_file", "file": str(path), "interfaces": SIDES}, "order": 1})
        return [row for row in preflight(parse_case(table)) if row.quantity == "faults.main: missing facets"]

    path = write(tmp_path / "a.msh", MshFileVersion=2.2)
    assert missing(path) == []
    (row,) = missing(without_a_facet(path))
    assert row.verdict == "warning" and row.value == 1
    x, y = (float(number) for number in row.note[row.note.index("(") + 1 : row.note.index(")")].split(","))
    left = min(build(path).points[:, 0])
    assert (x - left, y) == pytest.approx((11e-3, 0.0), abs=1e-9)
