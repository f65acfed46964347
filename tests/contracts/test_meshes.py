"""Every way of making the bodies, and the interface built on them: pairs, frames, weights, the exact transpose."""

from __future__ import annotations

import re
import signal
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import Given, case, march, plates, tilted, two_boxes, wavy_plates

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, MeshSource, RawMesh
from ruptfx.bodies.meshes._gmsh import session
from ruptfx.bodies.meshes.block_on_rigid import BlockOnRigid
from ruptfx.bodies.meshes.box_with_fault import BoxWithFault
from ruptfx.bodies.meshes.gmsh_file import RIDGES, GmshFile
from ruptfx.bodies.meshes.half_plate import HalfPlate
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.space.bodies import distribute, has_parts, named_facets, tied_facets
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.case import parse_case
from ruptfx.input.profiles.gaussian import Gaussian
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.faults.interface import Interface, build_interface
from ruptfx.interfaces.sliding import Sliding
from ruptfx.interfaces.sliding.interface import build_sliding
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

DATA = Path(__file__).parents[1] / "data"


def gmsh(folder: Path, **options: Any) -> GmshFile:
    pytest.importorskip("gmsh")
    table = tilted(folder, **options)
    return GmshFile.model_validate({key: table[key] for key in ("file", "interfaces")})


KINDS = alternatives("ruptfx.bodies.meshes")


def example(kind: str) -> Any:
    """What a kind of the folder gives as an example; its files are among the data of the tests."""
    table = tomllib.loads(f"mesh = {KINDS[kind].example}")["mesh"]
    assert table.pop("kind") == kind
    if "file" in KINDS[kind].model_fields:
        pytest.importorskip("gmsh")
    return KINDS[kind].model_validate(table, context={"directory": DATA})


HILL = Gaussian(background=0.0, amplitude=0.5e-3, center={"x": 1e-3, "y": 0.5e-3}, width=1e-3)
# Source, order, and the length (area) of its interface, where it has a closed form: every kind, and shapes of our own.
MESHES: dict[str, tuple[Callable[[Path], Any], int, float | None]] = {
    **{kind: (lambda _, kind=kind: example(kind), 3, None) for kind in KINDS},
    "wide_plates": (lambda _: TwoPlates(length=12e-3, height=4e-3, element_size=1e-3, left=-2e-3), 4, 12e-3),
    "gmsh_tilted": (lambda path: gmsh(path, angle=0.6), 3, 10e-3),
    "gmsh_upside_down": (lambda path: gmsh(path, angle=2.8), 2, 10e-3),
    "gmsh_triangles": (lambda _: example("gmsh_file"), 1, 40e-3),
    "wavy": (lambda _: wavy_plates(), 4, None),
    "boxes": (lambda _: two_boxes(), 2, 4e-3 * 3e-3),
    "half_box": (
        lambda _: example("box_with_fault").model_copy(update={"half": True}),
        2,
        0.5 * (9 - 1 / 3) * (4 - 1 / 6) * 1e-6,
    ),
    "dipping": (lambda _: example("box_with_fault").model_copy(update={"dip": 60.0, "fault_top": 1e-3}), 2, None),
    "hill": (lambda _: example("box_with_fault").model_copy(update={"dip": 60.0, "topography": HILL}), 2, None),
}
KINDS_THAT_END_INSIDE = {"box_with_fault", "dipping", "branched_fault", "half_box", "hill"}
every_mesh = pytest.mark.parametrize("mesh", MESHES)


def interface_of(mesh: str, folder: Path, components: int | None = None) -> tuple[Any, Interface]:
    """Displacement space and first interface; as many components as the mesh has dimensions, or as asked for."""
    make, order, _ = MESHES[mesh]
    return interface_in(make(folder), order, components)


def interface_in(mesh: MeshSource, order: int, components: int | None = None) -> tuple[Any, Interface]:
    raw = mesh.build()
    if not raw.interfaces:
        pytest.skip("has no interface")
    name = next(iter(raw.interfaces))
    bodies = distribute(fem.MPI.COMM_WORLD, mesh, sliding=raw.non_matching)
    space = fem.lagrange(bodies.mesh, order, components or bodies.mesh.geometry.dim)
    nodes = Nodes(space, bodies)
    return space, build_sliding(nodes, name, Sliding()) if name in raw.non_matching else build_interface(nodes, name)


@every_mesh
def test_raw_mesh_is_sound(mesh: str, tmp_path: Path) -> None:
    raw = MESHES[mesh][0](tmp_path).build()
    assert raw.cells.max() == len(raw.points) - 1 and len(np.unique(raw.cells)) == len(raw.points)
    assert len(raw.cell_body) == len(raw.cells) and set(raw.cell_body) == set(range(len(raw.bodies)))
    assert len(set(raw.bodies)) == len(raw.bodies)
    assert set(raw.one_sided) <= set(raw.interfaces)
    assert set(raw.one_sided.values()) <= {"rigid", "antisymmetric", "symmetric"}
    # No cell has two corners at one place; where there is an interface, no node belongs to two bodies.
    corners = raw.points[raw.cells]
    apart = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=-1) + np.eye(corners.shape[1])
    assert apart.min() > 1e-9
    used = [set(raw.cells[raw.cell_body == body].ravel().tolist()) for body in range(len(raw.bodies))]
    welded = {node for node, count in Counter(node for nodes in used for node in nodes).items() if count > 1}
    assert not welded or not raw.interfaces or KINDS_THAT_END_INSIDE & {mesh}
    for name, (plus, minus) in raw.interfaces.items():
        if name in raw.one_sided:
            np.testing.assert_array_equal(plus, minus)
        else:
            if name not in raw.non_matching:
                np.testing.assert_allclose(raw.points[plus], raw.points[minus], atol=1e-15)
            assert set(plus.ravel()) & set(minus.ravel()) <= welded
    # Named edges, and both sides of interfaces, are facets of one cell only.
    count = Counter(frozenset(row) for facet in FACETS[raw.cell] for row in raw.cells[:, list(facet)].tolist())
    for edge in [*raw.edges.values(), *(side for sides in raw.interfaces.values() for side in sides)]:
        assert len(edge) and all(count[frozenset(facet)] == 1 for facet in edge.tolist())


@every_mesh
def test_pairs_frames_and_weights(mesh: str, tmp_path: Path) -> None:
    space, face = interface_of(mesh, tmp_path)
    x = space.tabulate_dof_coordinates()
    slides = face.initial is not face
    if not slides:
        np.testing.assert_allclose(x[face.plus], x[face.minus], atol=1e-12)
        assert len(set(face.minus)) == face.total
    assert len(set(face.plus)) == face.total == len(face.plus)
    np.testing.assert_array_equal(face.number, np.arange(face.total))
    # Orthonormal, right-handed (normal, tangent): t = (n_y, -n_x) in 2D.
    identity = np.einsum("ikc,ijc->ikj", face.frame, face.frame)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(face.frame.shape[1]), identity.shape), atol=1e-12)
    if face.frame.shape[2] == 2:
        turned = np.stack([face.frame[:, 0, 1], -face.frame[:, 0, 0]], axis=1)
        np.testing.assert_allclose(face.frame[:, 1], turned, atol=1e-12)
    # Weights are positive and sum to the length of the facets (area); half of it where the other half is an image. What
    # slides may be curved.
    raw = MESHES[mesh][0](tmp_path).build()
    name, (plus, _) = next(iter(raw.interfaces.items()))
    share = 0.5 if raw.one_sided.get(name, "rigid") != "rigid" else 1.0
    assert face.weight.min() > 0
    whole = share * measure(raw.points[plus])
    if mesh in KINDS_THAT_END_INSIDE:  # the nodes of the rim belong to neither side
        assert 0.7 * whole < face.weight.sum() < whole
    else:
        np.testing.assert_allclose(face.weight.sum(), whole, rtol=1e-2 if slides else 1e-9)
    if MESHES[mesh][2] is not None:
        np.testing.assert_allclose(face.weight.sum(), MESHES[mesh][2], rtol=1e-10)
    assert np.all(np.diff(face.position) >= 0)


def measure(facets: np.ndarray) -> float:
    """Length of lines, or area of plane facets: two triangles where they have four corners."""
    sides = facets[:, 1:] - facets[:, :1]
    if facets.shape[1] == 2:
        return float(np.linalg.norm(sides[:, 0], axis=-1).sum())
    pairs = [(0, 1)] if facets.shape[1] == 3 else [(0, 2), (2, 1)]  # corners in tensor order: (0, 1, 3), (0, 3, 2)
    return float(sum(np.linalg.norm(np.cross(sides[:, i], sides[:, j]), axis=-1).sum() for i, j in pairs)) / 2


LATTICES = [kind for kind, cls in KINDS.items() if cls.lattice is not MeshSource.lattice]


@pytest.mark.parametrize("kind", LATTICES)
@pytest.mark.parametrize("parts, tied", [(1, ""), (2, "wrapped"), (3, ""), (4, "wrapped"), (6, "upright")])
def test_the_parts_of_a_lattice_make_it_up(kind: str, parts: int, tied: str) -> None:
    """Every cell is in one part, of about the same size; what belongs together is in the same one."""
    lattice = example(kind).lattice()
    raw = lattice.build()
    pieces = [lattice.part(number, parts, tied == "wrapped", tied == "upright") for number in range(parts)]
    owner = {tuple(cell): number for number, piece in enumerate(pieces) for cell in piece.tolist()}
    assert len(owner) == sum(map(len, pieces)) == len(raw.cells)
    assert set(owner) == {tuple(cell) for cell in raw.cells.tolist()}
    assert max(map(len, pieces)) <= 2 * min(map(len, pieces))
    at = {frozenset(pair): number for cell, number in owner.items() for local in FACETS[raw.cell]
          for pair in [tuple(cell[v] for v in local)]}  # fmt: skip
    together = list(raw.interfaces.values())
    if tied == "wrapped":
        together += [tied_facets(raw, "", f"{body}.left", f"{body}.right") for body in raw.bodies]
    if tied == "upright" and "lower.bottom" in raw.edges:
        together.append(tied_facets(raw, "", "lower.bottom", "upper.top"))
    for first, second in together:
        assert [at[frozenset(f)] for f in first.tolist()] == [at[frozenset(f)] for f in second.tolist()]
    # Names are found again by the numbers of the vertices.
    names = list(lattice.sides)
    for name, facets in named_facets(raw).items():
        assert {names[i] for i in lattice.side_of(facets)} == {name}


def test_parts_of_a_box_are_blocks_with_small_surfaces() -> None:
    """16 parts of 24 x 12 x 24 elements: 4 by 4 blocks of 6 x 12 x 6, of which an inner one shares 4 x 6 x 12 facets.

    Parts of one column and a half would have 2 x 12 x 24.
    """
    lattice = KINDS["box_with_fault"](
        fault_length=12.0, fault_width=12.0, element_size=1.0, beyond=6.0, distance=6.0, growth=1.0, fault_top=6.0,
    ).lattice()  # fmt: skip
    assert (lattice.columns, lattice.nodes(1)) == (24, 25 * 13 * 25)
    pieces = [lattice.part(number, 16) for number in range(16)]
    assert {len(piece) for piece in pieces} == {6 * 12 * 6}
    facets = [{frozenset(cell[list(local)].tolist()) for cell in piece for local in FACETS["hexahedron"]}
              for piece in pieces]  # fmt: skip
    between = [sum(len(one & other) for other in facets if other is not one) for one in facets]
    assert max(between) == 4 * 6 * 12
    # 2 columns of 24 for each of 12 parts; blocks need 3 rows at least: 8 of them, so 96 parts at most.
    assert [parts for parts in (12, 16, 24, 96, 97, 192) if has_parts(lattice, parts)] == [12, 16, 24, 96]


@pytest.mark.parametrize("kind", KINDS)
def test_case_with_it_is_at_rest(kind: str) -> None:
    """In a case, every interface pressed and glued, or open where its sides have meshes of their own: nothing moves,
    and the case is read again as it is written."""
    mesh = example(kind)
    raw, glued = mesh.build(), plates()["faults"]["main"]
    if not raw.interfaces:
        pytest.skip("has no interface")
    apart = {**glued, "initial_stress": {"normal": 0.0}, "sliding": {}}
    table = {**plates(), "mesh": {"kind": kind, **mesh.model_dump()}, "order": raw.order, "duration": 1e-6}
    table["plane"] = "solid" if raw.points.shape[1] == 3 else table["plane"]
    faults = {name: apart if name in raw.non_matching else glued for name in raw.interfaces}
    resting = parse_case({**table, "faults": faults})
    assert parse_case(tomllib.loads(resting.to_toml())) == resting
    _, _, state = march(resting)
    assert state.step > 1 and np.all(state.velocity == 0)


def test_arc_length_and_normal_of_an_inclined_interface(tmp_path: Path) -> None:
    _, face = interface_of("gmsh_tilted", tmp_path)
    assert face.position[0] == 0 and np.isclose(face.position[-1], 10e-3, rtol=1e-9)
    # Lower is the minus body; turned by 0.6 rad, the normal from minus to plus is (-sin, cos).
    np.testing.assert_allclose(face.frame[:, 0], np.tile([-np.sin(0.6), np.cos(0.6)], (face.total, 1)), atol=1e-9)


# Two quarters of a ring between 8 and 10, and 10 and 13 mm, 1 rad wide; they share their nodes, or have their own.
RING = """
Mesh.ElementOrder = {order}; own = {own}; t = 1.0;
Point(1) = {{0, 0, 0}}; Point(2) = {{8, 0, 0}}; Point(3) = {{10, 0, 0}}; Point(4) = {{13, 0, 0}};
Point(5) = {{8 * Cos(t), 8 * Sin(t), 0}}; Point(6) = {{10 * Cos(t), 10 * Sin(t), 0}};
Point(7) = {{13 * Cos(t), 13 * Sin(t), 0}};
Circle(1) = {{2, 1, 5}}; Circle(2) = {{3, 1, 6}}; Circle(3) = {{4, 1, 7}};
Line(4) = {{2, 3}}; Line(5) = {{5, 6}}; outer = 2; low = 3; high = 6;
If (own)
  Point(8) = {{10, 0, 0}}; Point(9) = {{10 * Cos(t), 10 * Sin(t), 0}}; Circle(8) = {{8, 1, 9}};
  outer = 8; low = 8; high = 9;
EndIf
Line(6) = {{low, 4}}; Line(7) = {{high, 7}};
Curve Loop(1) = {{4, 2, -5, -1}}; Curve Loop(2) = {{6, 3, -7, -outer}};
Plane Surface(1) = {{1}}; Plane Surface(2) = {{2}};
Transfinite Curve{{1, 2}} = 5; Transfinite Curve{{outer, 3}} = 5 + 2 * own; Transfinite Curve{{4, 5, 6, 7}} = 3;
Transfinite Surface{{1, 2}}; Recombine Surface{{1, 2}};
Physical Surface("inner") = {{1}}; Physical Surface("outer") = {{2}}; Physical Curve("outer.side") = {{3}};
If (own)
  Physical Curve("main") = {{2, 8}};
Else
  Physical Curve("main") = {{2}};
EndIf
"""


@pytest.mark.parametrize("own", [0, 1])
def test_second_order_cells_follow_an_arc(own: int, tmp_path: Path) -> None:
    """A radius of 10 mm and 1 rad on four elements: chords are together 1 - 0.25^2 / 24 of the arc, parabolas nearly
    all."""
    pytest.importorskip("gmsh")
    for order, length in ((1, 1 - 0.25**2 / 24), (2, 1.0)):
        path = tmp_path / f"ring_{order}.geo"
        path.write_text(RING.format(order=order, own=own))
        sides = {"plus": "outer", "minus": "inner", "matching": not own}
        mesh = GmshFile.model_validate({"file": str(path), "interfaces": {"main": sides}, "scale": 1e-3})
        raw = mesh.build()
        assert raw.order == order and len(np.unique(raw.cells)) == len(raw.points)
        used = [set(raw.cells[raw.cell_body == body].ravel()) for body in (0, 1)]
        assert not used[0] & used[1]
        if own and order == 1:  # the chords of either side cut the other's corners
            with pytest.raises(RuptfxError, match=facts(r"the bodies overlap by 2\.2")):
                interface_in(mesh, 4)
            continue
        _, face = interface_in(mesh, 4)
        np.testing.assert_allclose(face.weight.sum(), 10e-3 * length, rtol=1e-4)
        if order == 2:
            radial = face.points / np.linalg.norm(face.points, axis=1, keepdims=True)
            np.testing.assert_allclose(np.linalg.norm(face.points, axis=1), 10e-3, rtol=1e-4)
            np.testing.assert_allclose(face.frame[:, 0], radial, atol=5e-3)  # from the inner to the outer body


# The same ring as a solid, 5 mm along z.
RING_IN_SOLIDS = """
{ring}
e[] = Extrude {{0, 0, 5}} {{ Surface{{1}}; Layers{{2}}; Recombine; }};
f[] = Extrude {{0, 0, 5}} {{ Surface{{2}}; Layers{{2}}; Recombine; }};
Physical Volume("inner") = {{e[1]}}; Physical Volume("outer") = {{f[1]}}; Physical Surface("main") = {{e[3], f[5]}};
"""


def with_own_nodes(path: Path, script: Path, away: float) -> None:
    """Write the mesh of a script with nodes of their own on the plus side of `main`, 1 + away times as far from z."""
    import meshio

    with session() as gmsh:
        gmsh.open(str(script))
        gmsh.model.mesh.generate(3)
        gmsh.write(str(path))
    mesh = meshio.gmsh.read(path)
    groups = {name: number for name, (number, _) in mesh.field_data.items()}
    tags = mesh.cell_data["gmsh:physical"]
    facets = np.concatenate([block.data for block, tag in zip(mesh.cells, tags, strict=True) if block.dim == 2])
    own = np.unique(facets)
    copy = np.arange(len(mesh.points))
    copy[own] = len(copy) + np.arange(len(own))
    cells = [(block.type, copy[block.data] if tag[0] == groups["outer"] else block.data)
             for block, tag in zip(mesh.cells, tags, strict=True) if block.dim == 3]  # fmt: skip
    cells += [("quad9", facets), ("quad9", copy[facets])]
    numbers = [*(tag for block, tag in zip(mesh.cells, tags, strict=True) if block.dim == 3),
               *[np.full(len(facets), groups["main"])] * 2]  # fmt: skip
    points = np.concatenate([mesh.points, mesh.points[own] * [1 + away, 1 + away, 1]])
    data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
    whole = meshio.Mesh(points, cells, cell_data=data, field_data=mesh.field_data)
    meshio.write(path, whole, file_format="gmsh22", binary=False)


@pytest.mark.parametrize("order, own", [(1, 0), (2, 0), (2, 1)])
def test_hexahedra_of_27_nodes_follow_a_cylinder(order: int, own: int, tmp_path: Path) -> None:
    """Chords and parabolas as in the plane, with shared nodes and with own ones 0.9e-4 of a facet apart."""
    pytest.importorskip("gmsh")
    path = tmp_path / "ring.geo"
    path.write_text(RING_IN_SOLIDS.format(ring=RING[: RING.index("Physical")].format(order=order, own=0)))
    if own:
        with_own_nodes(tmp_path / "ring.msh", path, 0.9e-4 * 2.5 / 10)
    sides = {"main": {"plus": "outer", "minus": "inner"}}
    file = path.with_suffix(".msh" if own else ".geo")
    mesh = GmshFile.model_validate({"file": str(file), "interfaces": sides, "scale": 1e-3})
    raw = mesh.build()
    assert raw.order == order and raw.cells.shape == (32, 8 if order == 1 else 27)
    assert len(np.unique(raw.cells)) == len(raw.points) == 2 * (4 * order + 1) * (2 * order + 1) ** 2
    assert len(np.unique(raw.points, axis=0)) == len(raw.points) - (4 * order + 1) * (2 * order + 1)
    _, face = interface_in(mesh, 2)
    length = 1.0 if order == 2 else 1 - 0.25**2 / 24
    np.testing.assert_allclose(face.weight.sum(), 10e-3 * length * 5e-3, rtol=1e-4)
    if order == 2:
        for place, vertices in enumerate(
            (*RIDGES, *FACETS["hexahedron"], tuple(range(8))), 8
        ):  # up to 0.1 mm off chords
            middle = raw.points[raw.cells[:, vertices]].mean(axis=1)
            np.testing.assert_allclose(raw.points[raw.cells[:, place]], middle, atol=0.15e-3)
        radial = face.points * [1, 1, 0] / np.linalg.norm(face.points[:, :2], axis=1, keepdims=True)
        np.testing.assert_allclose(np.linalg.norm(face.points[:, :2], axis=1), 10e-3, rtol=1e-4 if own else 1e-12)
        np.testing.assert_allclose(face.frame[:, 0], radial, atol=5e-3)  # from the inner to the outer body


def test_a_chamfered_block() -> None:
    """12 x 4 mm without two triangles of 0.7 x 0.7 mm; what is left of the interface is 10.6 mm long."""
    block = BlockOnRigid(length=12e-3, height=4e-3, element_size=1e-3, left=2e-3, chamfer=0.7e-3)
    raw = block.build()
    corner = raw.points[raw.cells]  # in tensor order
    diagonals = corner[:, 3] - corner[:, 0], corner[:, 2] - corner[:, 1]
    area = 0.5 * (diagonals[0][:, 0] * diagonals[1][:, 1] - diagonals[0][:, 1] * diagonals[1][:, 0])
    assert area.min() > 0
    np.testing.assert_allclose(area.sum(), 12e-3 * 4e-3 - 0.7e-3**2, rtol=1e-12)
    _, face = interface_in(block, 4)
    np.testing.assert_allclose(face.weight.sum(), 10.6e-3, rtol=1e-12)
    np.testing.assert_allclose(face.points[[0, -1], 0], [2.7e-3, 13.3e-3], rtol=1e-12)
    # The chamfer is straight, from (2.7, 0) to (2.0, 0.7) mm, and belongs to the edge above it.
    edge = raw.points[np.unique(raw.edges["upper.left"])]
    np.testing.assert_allclose(np.maximum(2.7e-3 - edge[:, 1], 2e-3), edge[:, 0], rtol=1e-12)
    assert edge[:, 1].min() == 0 and edge[:, 1].max() == 4e-3
    low = BlockOnRigid(length=12e-3, height=1e-3, element_size=1e-3, chamfer=0.4e-3)
    assert low.lattice().rows == [2] and low.lattice().levels["upper"][1] == 0.4e-3
    with pytest.raises(CaseError, match=facts(r"chamfer = 0\.006 m: it must be less than half of the length")):
        BlockOnRigid(length=12e-3, height=40e-3, element_size=1e-3, chamfer=6e-3)


def test_arc_length_of_a_wavy_interface(tmp_path: Path) -> None:
    _, face = interface_of("wavy", tmp_path)
    # Straight pieces between the vertices at x = 0, 1, ... 12 mm on the sine of amplitude 0.4 mm, period 6 mm.
    x = np.linspace(0, 12e-3, 13)
    length = np.hypot(np.diff(x), np.diff(4e-4 * np.sin(2 * np.pi * x / 6e-3))).sum()
    np.testing.assert_allclose([face.weight.sum(), face.position[-1]], length, rtol=1e-9)


@every_mesh
def test_exact_transpose(mesh: str, tmp_path: Path) -> None:
    """<W t, J u> = <J' W t, u> for any t and u."""
    space, face = interface_of(mesh, tmp_path)
    random = np.random.default_rng(2)
    u = random.normal(size=len(space.tabulate_dof_coordinates()) * face.frame.shape[2])
    t = random.normal(size=face.frame.shape[:2])
    force = np.zeros_like(u)
    face.assemble(t, force)
    left = np.sum(face.weight[:, None] * t * face.rate(u))
    assert abs(left - force @ u) < 1e-13 * np.sum(np.abs(force * u))
    pushed = u.copy()
    face.add_force(pushed, t, scale=np.full_like(u, 2.0))
    np.testing.assert_allclose(pushed, u - 2 * force, rtol=1e-13, atol=1e-13)


PLATE = {"length": 12e-3, "height": 4e-3, "element_size": 1e-3}
ONE_SIDED = {
    "rigid": (BlockOnRigid(**PLATE), [1, 1], 1.0),
    "antisymmetric": (HalfPlate(**PLATE, symmetry="antisymmetric"), [0, 2], 0.5),
    "symmetric": (HalfPlate(**PLATE, symmetry="symmetric"), [2, 0], 0.5),
}  # mesh, jump over displacement of the plus side (normal, tangential), area that counts over the whole


@pytest.mark.parametrize("side", ONE_SIDED)
def test_exact_transpose_of_one_side(side: str) -> None:
    """<W t, J u> = <J' W t, u>; J turns (right, up) = (2, 3) into a normal part of 3 and a tangential one of 2."""
    mesh, factors, share = ONE_SIDED[side]
    model = Model(case({"mesh": {"kind": type(mesh).kind(), **mesh.model_dump()}}))
    face, random = model.faults[0].interface, np.random.default_rng(2)
    assert face.other_side == side
    u, t = random.normal(size=model.nodes * 2), random.normal(size=(face.total, 2))
    force = np.zeros_like(u)
    face.assemble(t, force)
    left = np.sum(face.weight[:, None] * t * face.jump(u))
    assert abs(left - force @ u) < 1e-13 * np.sum(np.abs(force * u))
    moved = np.tile([2.0, 3.0], model.nodes)
    np.testing.assert_allclose(face.jump(moved), np.tile(np.array([3.0, 2.0]) * factors, (face.total, 1)), rtol=1e-14)
    np.testing.assert_allclose(face.weight.sum(), share * 12e-3, rtol=1e-12)


@every_mesh
def test_rigid_motion_has_no_jump(mesh: str, tmp_path: Path) -> None:
    space, face = interface_of(mesh, tmp_path)
    if face.one_sided:
        pytest.skip("what moves against a side that is not meshed has a jump")
    dim = face.frame.shape[2]
    x = space.tabulate_dof_coordinates()[:, :dim]
    random = np.random.default_rng(4)
    spin = random.normal(size=(dim, dim))
    motion = random.normal(size=dim) + x @ (spin - spin.T)
    if face.initial is not face:  # bodies that are apart turn away from each other: by the gap times the angle
        motion = np.broadcast_to(random.normal(size=dim), x.shape)
    assert np.max(np.abs(face.rate(motion.ravel()))) < 1e-12


def test_antiplane_has_one_component(tmp_path: Path) -> None:
    space, face = interface_of("wide_plates", tmp_path, components=1)
    assert not face.has_normal and face.tangents == 1 and face.frame.shape == (face.total, 1, 1)
    np.testing.assert_allclose(face.weight.sum(), 12e-3, rtol=1e-12)
    moved = np.zeros(len(space.tabulate_dof_coordinates()))
    moved[face.plus] = 3.0  # slip is plus minus minus
    np.testing.assert_array_equal(face.jump(moved), np.full((face.total, 1), 3.0))


def test_opening_and_slip_have_the_right_sign(tmp_path: Path) -> None:
    space, face = interface_of("wide_plates", tmp_path)
    x = space.tabulate_dof_coordinates()[:, :2]
    moved = np.zeros_like(x)
    moved[face.plus] = [2.0, 3.0]  # the upper (plus) body goes right and up
    opening, slip = face.split(face.jump(moved.ravel()))
    assert np.all(opening == 3.0) and np.all(slip == 2.0)


def test_growth_of_rows() -> None:
    levels = TwoPlates(length=1.0, height=0.5, element_size=0.05, growth=1.2).levels()
    sizes = np.diff(levels)
    assert levels[0] == 0 and np.isclose(levels[-1], 0.5)
    np.testing.assert_allclose(sizes[1:] / sizes[:-1], 1.2)
    assert sizes[0] <= 0.05


# -- what is refused -----------------------------------------------------------------------------------------------


def with_interfaces(folder: Path, names: dict[str, Any]) -> GmshFile:
    table = tilted(folder)
    return GmshFile.model_validate({"file": table["file"], "interfaces": names})


@pytest.mark.parametrize(
    "names, message",
    [
        ({"fault": {"plus": "upper", "minus": "lower"}},
         r"no interface 'fault' among the named facets; it has: lower\.bottom, lower\.left, .*main"),
        ({"main": {"plus": "top", "minus": "lower"}}, r"no body 'top'; the file has: lower, upper"),
    ],
)  # fmt: skip
def test_names_that_are_not_there(names: dict[str, Any], message: str, tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    with pytest.raises(RuptfxError, match=facts(message)):
        with_interfaces(tmp_path, names).build()


@pytest.mark.parametrize(
    "content, message", [(None, "cannot be read .No such file"), ("nonsense", "not a mesh that can be read")]
)
def test_files_that_are_no_mesh(content: str | None, message: str, tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    path = tmp_path / "some.msh"
    if content is not None:
        path.write_text(content)
    mesh = GmshFile(file=str(path), interfaces={"main": {"plus": "upper", "minus": "lower"}})
    with pytest.raises(RuptfxError, match=facts(f"some.msh.*{message}")):
        mesh.build()


SEPARATE = """
SetFactory("Built-in");
Point(1) = {{0, -1, 0}}; Point(2) = {{4, -1, 0}}; Point(3) = {{4, 0, 0}}; Point(4) = {{0, 0, 0}};
Point(5) = {{0, 0, 0}}; Point(6) = {{4, 0, 0}}; Point(7) = {{4, 1, 0}}; Point(8) = {{0, 1, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Line(5) = {{5, 6}}; Line(6) = {{6, 7}}; Line(7) = {{7, 8}}; Line(8) = {{8, 5}};
Curve Loop(1) = {{1, 2, 3, 4}}; Curve Loop(2) = {{5, 6, 7, 8}};
Plane Surface(1) = {{1}}; Plane Surface(2) = {{2}};
Transfinite Curve{{1, 3}} = {lower}; Transfinite Curve{{5, 7}} = {upper}; Transfinite Curve{{2, 4, 6, 8}} = 2;
Transfinite Surface{{1, 2}}; Recombine Surface{{1, 2}};
Physical Surface("lower") = {{1}}; Physical Surface("upper") = {{2}}; Physical Curve("main") = {{3, 5}};
"""


@pytest.mark.parametrize("upper", [5, 6])
def test_bodies_with_their_own_nodes(upper: int, tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    path = tmp_path / "separate.geo"
    path.write_text(SEPARATE.format(lower=5, upper=upper))
    mesh = GmshFile(file=str(path), interfaces={"main": {"plus": "upper", "minus": "lower"}}, scale=1e-3)
    if upper == 5:
        plus, minus = mesh.build().interfaces["main"]
        assert len(plus) == len(minus) == 4
    else:
        with pytest.raises(RuptfxError, match=facts(r"sides do not match \(6 on the plus, 5 on the minus side")):
            mesh.build()


def test_nodes_that_do_not_match() -> None:
    """The check on the finite element nodes themselves, whatever made the mesh."""
    raw = TwoPlates(length=4e-3, height=1e-3, element_size=1e-3).build()
    plus, _ = raw.interfaces["main"]
    raw.points[plus[1, 0], 0] += 1e-4
    bodies = distribute(fem.MPI.COMM_WORLD, Given(raw))
    space = fem.lagrange(bodies.mesh, 2, 2)
    with pytest.raises(
        RuptfxError, match=facts(r"interface 'main': the nodes of the two sides do not match .*nearest")
    ):
        build_interface(Nodes(space, bodies), "main")


def test_folded_elements() -> None:
    raw = TwoPlates(length=4e-3, height=1e-3, element_size=1e-3).build()
    raw.points[np.argmax(raw.points[:, 1] - raw.points[:, 0]), 0] += 3e-3
    with pytest.raises(RuptfxError, match=facts(r"mesh: \d+ .*quadrilaterals.* \(\S+, \S+\) m")):
        distribute(fem.MPI.COMM_WORLD, Given(raw))


def test_an_error_in_a_source_reaches_the_caller() -> None:
    class Broken(MeshSource):
        def build(self) -> RawMesh:
            raise RuptfxError("no mesh today")

    with pytest.raises(RuptfxError, match="no mesh today"):
        distribute(fem.MPI.COMM_WORLD, Broken())


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"faults": {}}, r"the mesh has the interface 'main', which needs \[faults.main\]"),
        ({"faults.other": {"contact": "split_node", "friction": {"kind": "coulomb", "mu_d": 0.3},
                           "initial_stress": {"normal": 1e6}}}, r"faults.other: .* it has: main"),
        ({"materials": {"uper": {"kind": "isotropic_elastic", "young_modulus": 1e9, "poisson_ratio": 0.3,
                                 "density": 1e3}}}, r"materials.uper: no such body, did you mean 'upper'"),
        ({"boundaries": [{"kind": "absorbing", "edge": "upper.botom"}]},
         r"boundaries.0.edge = 'upper.botom': no such edge, did you mean '(upper.top|lower.bottom)'"),
        ({"boundaries": [{"kind": "absorbing", "edge": "main.plus"}]}, r"edge = 'main.plus': no such edge"),
        ({"plane": "solid"}, r"plane = 'solid': the mesh has 2 dimensions"),
    ],
)  # fmt: skip
def test_cases_that_do_not_fit_their_mesh(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        Model(case(changes))


def test_after_gmsh_a_pipe_that_nobody_reads_is_an_error_of_python() -> None:
    """Not the end of the process, as the system has it and Gmsh leaves it: a run may write to processes that ended."""
    pytest.importorskip("gmsh")
    with session():
        pass
    ignored = re.search(r"SigIgn:\s+(\w+)", Path("/proc/self/status").read_text(encoding="ascii"))
    assert ignored is not None and int(ignored[1], 16) >> (signal.SIGPIPE - 1) & 1


@pytest.mark.parametrize("dip", [30.0, 60.0, 90.0])
def test_a_section_across_a_dipping_fault(dip: float) -> None:
    """6 m of fault in elements of 1 m, 3 m below it: the hanging wall is above, positions are distances down dip."""
    mesh = {
        "kind": "dipping_section",
        "fault_width": 6.0,
        "beyond": 3.0,
        "distance": 4.0,
        "element_size": 1.0,
        "dip": dip,
    }
    model = Model(case({"mesh": mesh, "order": 1}), fem.MPI.COMM_SELF)
    face, angle = model.faults[0].interface, np.deg2rad(dip)
    down = np.array([np.cos(angle), -np.sin(angle)])
    np.testing.assert_allclose(face.points, np.outer(np.arange(10.0), down), atol=1e-12)
    np.testing.assert_allclose(face.position - face.position[0], np.arange(10.0), atol=1e-9)
    np.testing.assert_allclose(face.frame[:, 0], np.tile([np.sin(angle), np.cos(angle)], (10, 1)), atol=1e-9)
    np.testing.assert_allclose(face.frame[:, 1], np.tile(down, (10, 1)), atol=1e-9)
    raw = KINDS["dipping_section"].model_validate({k: v for k, v in mesh.items() if k != "kind"}).build()
    for body, sign in (("plus", 1), ("minus", -1)):
        top, bottom, far = (raw.points[np.unique(raw.edges[f"{body}.{edge}"])] for edge in ("top", "bottom", "far"))
        np.testing.assert_allclose(top, np.outer(sign * np.arange(5.0), [1, 0])[:: int(sign)], atol=1e-9)
        np.testing.assert_allclose(bottom[:, 1], -9 * np.sin(angle))
        np.testing.assert_allclose(far[:, 0] + far[:, 1] / np.tan(angle), sign * 4.0, atol=1e-9)


def test_a_dipping_fault_has_no_half() -> None:
    fields = {"fault_length": 9e-3, "fault_width": 4e-3, "element_size": 1e-3, "beyond": 2e-3, "distance": 3e-3}
    with pytest.raises(ValueError, match=facts(r"half = true: .*dips at 60 degrees.*leave out half, or make dip 90")):
        BoxWithFault.model_validate({**fields, "dip": 60.0, "half": True})


def test_a_rough_fault_has_no_half() -> None:
    fields = {"fault_length": 9e-3, "fault_width": 4e-3, "element_size": 1e-3, "beyond": 2e-3, "distance": 3e-3}
    with pytest.raises(ValueError, match=facts(r"half = true: .*rough fault.*leave out half, or height")):
        BoxWithFault.model_validate({**fields, "height": 1e-4, "half": True})
    assert BoxWithFault.model_validate({**fields, "height": 0.0, "half": True}).half
