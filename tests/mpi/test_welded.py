"""Bodies welded to each other and faults in several parts: the same as whole ones, on any number of ranks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, CREEPING, HOMALITE, SPLIT, Given, blocks, merged, plates

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import RawMesh
from ruptfx.bodies.meshes.gmsh_file import GmshFile
from ruptfx.bodies.space.bodies import distribute
from ruptfx.bodies.space.edges import Edge
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.case import parse_case
from ruptfx.interfaces.faults.interface import build_interface
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
TWO, FOUR = {"lower": "1, 2", "upper": "3, 4"}, {"a": "1", "b": "2", "c": "3", "d": "4"}
HALVES = {"west": "11", "east": "21"}


def on_root(make: Any) -> Any:
    return parallel.on_root(COMM, make)


def table(folder: Path, bodies: dict[str, str], faults: dict[str, str], plus: Any, minus: Any) -> dict[str, Any]:
    """A rupture that begins at x = -2 mm on the line y = 0 and crosses x = 0."""
    sides = {name: {"plus": plus, "minus": minus} for name in faults}
    whole = plates({
        "order": 3, "positions": "x", "mesh": on_root(lambda: blocks(folder, bodies, faults, sides)), "faults": {},
        "boundaries": [{"kind": "absorbing", "edge": edge} for edge in ("top", "bottom")],
        "stepper": {"kind": "leapfrog", "time_step": 5e-8},
    })  # fmt: skip
    patch = {"kind": "boxcar", "inside": 4e6, "outside": 3.2e6, "center": -2e-3, "half_width": 1.5e-3}
    for name in faults:
        whole["faults"][name] = {
            "contact": SPLIT, "friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 1e-6},
            "initial_stress": {"normal": 6e6, "shear": patch},
        }  # fmt: skip
    return whole


def run(given: dict[str, Any], changes: dict[str, Any], steps: int) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Fields of all points in the order of x, and the energies, after some steps."""
    per_fault = {key: value for key, value in changes.items() if key in ("contact", "friction")}
    given = merged(given, {key: value for key, value in changes.items() if key not in per_fault})
    for fault in given["faults"].values():
        fault.update(per_fault)
    model = Model(parse_case(given))
    motion, state = model.case.stepper.bind(model), model.initial_state()
    for _ in range(steps):
        motion.step(state)
    rows, names = [], ["x", "weight", *state.faults[model.faults[0].name]]
    for fault in model.faults:
        face, fields = fault.interface, state.faults[fault.name]
        assert np.array_equal(np.sort(parallel.share_rows(COMM, face.number[face.owned])), np.arange(face.total))
        rows.append(np.column_stack([face.points[:, 0], face.weight, *fields.values()])[face.owned])
    everything = parallel.share_rows(COMM, np.concatenate(rows))
    everything = everything[np.argsort(everything[:, 0])]
    return dict(zip(names, everything.T, strict=True)), motion.energies(state)


VARIANTS = {
    "two materials": (FOUR, {"main": "11, 21"}, ["c", "d"], ["a", "b"]),
    "two parts": (TWO, HALVES, "upper", "lower"),
    "two materials and two parts": (FOUR, HALVES, ["c", "d"], ["a", "b"]),
}
IMPLICIT = {
    "contact": COMPLIANT, "friction": {"kind": "coulomb", "mu_d": 0.5},
    "stepper": {"kind": "quasi_static", "first_step": 1e-7, "slip_tolerance": 1e-6, "radiation_damping": True},
    "boundaries": [
        {"kind": "driven", "edge": edge, "component": component, "velocity": 0.0}
        for edge in ("top", "bottom") for component in "xy"
    ],
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(
    "changes, steps", [({}, 120), ({"contact": COMPLIANT}, 120), (IMPLICIT, 6)],
    ids=["split_node", "compliant", "quasi_static"],
)  # fmt: skip
def test_the_same_as_uncut(variant: str, changes: dict[str, Any], steps: int, shared_tmp_path: Path) -> None:
    whole, energy = run(table(shared_tmp_path, TWO, {"main": "11, 21"}, "upper", "lower"), changes, steps)
    parts, same = run(table(shared_tmp_path, *VARIANTS[variant]), changes, steps)
    assert np.abs(whole["slip"][np.abs(whole["x"]) < 1e-9]).max() > 1e-8  # it slips where the parts meet
    for name, value in whole.items():
        # Newton's iteration of implicit steps ends at 1e-8.
        slack = (1e-11 if "stepper" not in changes else 1e-7) * np.nanmax(np.abs(value), initial=1e-300)
        np.testing.assert_allclose(parts[name], value, rtol=0, atol=slack, err_msg=name)
    if "stepper" not in changes:
        size = max(map(abs, energy.values()))
        assert all(abs(same[name] - energy[name]) < 1e-10 * size for name in energy)
        assert abs(2 * same["boundary_work"] - sum(same.values())) < 1e-10 * size


def test_other_materials_in_the_layers_matter(shared_tmp_path: Path) -> None:
    """The energy closes where a fault crosses a layer of another material, and the slip is not that of one."""
    given = table(shared_tmp_path, *VARIANTS["two materials and two parts"])
    plain, _ = run(given, {}, 120)
    soft = {**HOMALITE, "young_modulus": 3e9}
    layered, energy = run(given, {"materials": {"default": HOMALITE, "b": soft, "d": soft}}, 120)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    assert abs(lost) < 1e-10 * energy["frictional_dissipation"]
    assert np.abs(layered["slip"] - plain["slip"]).max() > 1e-2 * plain["slip"].max()


def points(folder: Path, bodies: dict[str, str], faces: dict[str, str], plus: Any, minus: Any, dim: int) -> np.ndarray:
    """Place, weight and frame of the points of all interfaces, in the order of their places."""
    sides = {name: {"plus": plus, "minus": minus} for name in faces}
    mesh = on_root(lambda: blocks(folder, bodies, faces, sides, dim))
    parts = distribute(COMM, GmshFile(file=mesh["file"], interfaces=mesh["interfaces"]))
    space, rows = fem.lagrange(parts.mesh, 2, dim), []
    for name in faces:
        face = build_interface(Nodes(space, parts), name)
        frame = face.frame.reshape(len(face.plus), dim**2)
        rows.append(np.column_stack([face.points, face.weight, frame])[face.owned])
    everything = parallel.share_rows(COMM, np.concatenate(rows))
    return everything[np.lexsort(np.round(everything[:, :dim], 9).T[::-1])]


def test_shared_nodes_belong_to_the_first_body(shared_tmp_path: Path) -> None:
    """On any number of ranks: a (0) before b, c (2) before d; 3 elements of order 3 and one node more on x = 0."""
    model = Model(parse_case(table(shared_tmp_path, *VARIANTS["two materials"])))
    on_line = np.abs(model.coordinates[:, 0]) < 1e-9
    assert set(model.layout.body[on_line]) <= {0, 2}
    for body in (0, 2):
        count = np.sum((model.layout.body == body)[: model.owned_nodes] & on_line[: model.owned_nodes])
        assert parallel.total(COMM, count) == 10


LAYER = {"kind": "sponge", "edge": "top", "width": 2e-3}
OTHER_NAMES = {"a": "1", "b": "2", "d": "3", "c": "4"}


def dashpots(folder: Path, bodies: dict[str, str], plus: Any, minus: Any, boundary: dict[str, Any]) -> np.ndarray:
    """Places and dashpots of all nodes, in an order that no name of a body changes."""
    given = table(folder, bodies, {"main": "11, 21"}, plus, minus)
    model = Model(parse_case({**given, "boundaries": [boundary]}))
    rows = np.column_stack([model.coordinates, model.loads.dashpot.reshape(-1, 2)])[: model.owned_nodes]
    rows = parallel.share_rows(COMM, rows)
    return rows[np.lexsort((rows[:, 3], *np.round(rows[:, :2].T, 9)))]


@pytest.mark.parametrize("names", [FOUR, OTHER_NAMES], ids=["in order", "other names"])
def test_a_sponge_damps_all_bodies_of_its_edge(names: dict[str, str], shared_tmp_path: Path) -> None:
    whole = dashpots(shared_tmp_path, TWO, "upper", "lower", LAYER)
    parts = dashpots(shared_tmp_path, names, ["c", "d"], ["a", "b"], LAYER)
    assert np.count_nonzero(whole[:, 3]) > np.count_nonzero(np.isclose(whole[:, 1], whole[:, 1].max()))
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-13 * whole[:, 3].max())


def test_sponges_of_a_mirrored_branch(shared_tmp_path: Path) -> None:
    """`minus` is beside the branch at negative angles, `plus` at positive ones; both are welded along y = 0."""
    sums = []
    for angle, body in ((-35.0, "minus"), (35.0, "plus")):
        given = table(shared_tmp_path, TWO, {"main": "11, 21"}, "upper", "lower")
        fault = given["faults"].pop("main") | {"initial_stress": {"normal": 6e6}}
        given |= {"boundaries": [{"kind": "sponge", "edge": f"{body}.left", "width": 2e-3}],
                  "faults": {"main": fault, "branch": fault},
                  "mesh": {"kind": "branched_fault", "left": -4e-3, "right": 4e-3, "branch_length": 3e-3,
                           "angle": angle, "element_size": 1.5e-3, "beyond": 3e-3, "growth": 1.2}}  # fmt: skip
        model = Model(parse_case(given))
        sums.append(parallel.total(COMM, model.loads.dashpot.reshape(-1, 2)[: model.owned_nodes].sum(axis=0)))
    np.testing.assert_allclose(sums[0], sums[1], rtol=1e-12)


def test_nodes_of_a_weld_have_the_mass_of_both_bodies(shared_tmp_path: Path) -> None:
    """An initial velocity of one body has the momentum of its own mass, and masses of bodies sum to the whole."""
    given = table(shared_tmp_path, *VARIANTS["two materials"])
    given["materials"]["c"] = {**HOMALITE, "density": 3 * HOMALITE["density"]}
    model = Model(parse_case({**given, "boundaries": [], "initial_velocity": {"c": [2.0, 0.0]}}))
    shares = [model.mass_of(number) for number in range(4)]
    np.testing.assert_allclose(np.sum(shares, axis=0), model.mass, rtol=1e-13)
    owned, welded = slice(model.owned_nodes), model.layout.touches.sum(axis=0) > 1
    assert parallel.total(COMM, welded[owned].sum()) == 20  # on x = 0, above and below
    mass, velocity = model.mass.reshape(-1, 2)[owned, 0], model.initial_velocity().reshape(-1, 2)[owned, 0]
    area = 6e-3 * 4e-3
    assert parallel.total(COMM, mass @ velocity) == pytest.approx(2.0 * 3 * HOMALITE["density"] * area, rel=1e-12)
    both = welded[owned] & model.layout.touches[2][owned]
    np.testing.assert_allclose(velocity[both], 2.0 * 3 / 4, rtol=1e-11)  # Gmsh places vertices within 1e-12


def test_files_have_the_body_of_every_cell(shared_tmp_path: Path) -> None:
    """At order 3 a cell of the file is a ninth of an element; those at a weld have its points."""
    model = Model(parse_case(table(shared_tmp_path, *VARIANTS["two materials"])))
    topology = BulkFields(model).topology()
    points, cells, body = (
        parallel.share_rows(COMM, each) for each in (topology.points, topology.cells, topology.body_of_cell)
    )
    x, y = points[cells].mean(axis=1).T
    np.testing.assert_array_equal(body, 2 * (y > 0) + (x > 0))


@pytest.mark.parametrize("gap", [0.0, 1e-3])
@pytest.mark.parametrize("dim", [2, 3])
def test_bodies_without_a_connection_are_refused(dim: int, gap: float) -> None:
    """Two boxes on each other with an interface, and a third one on top with nodes of its own, 3 (9) of them below."""
    column = np.array([[x, y] for y in range(3) for x in range(3)], dtype=float) * 1e-3
    square = np.array([[0, 1, 3, 4], [1, 2, 4, 5], [3, 4, 6, 7], [4, 5, 7, 8]])
    points = [column + np.array([0.0, 2e-3 * k + gap * (k == 2)]) for k in range(3)]
    cells, under, above = [square + 9 * k for k in range(3)], np.array([[6, 7], [7, 8]]), np.array([[9, 10], [10, 11]])
    kind, points, cells = "quadrilateral", np.concatenate(points), np.concatenate(cells)
    if dim == 3:
        kind, count = "hexahedron", len(points)
        points = np.concatenate([np.column_stack([points, np.full(count, 1e-3 * z)]) for z in range(3)])
        cells = np.concatenate([np.hstack([cells + count * z, cells + count * (z + 1)]) for z in range(2)])
        under, above = (
            np.concatenate([np.hstack([each + count * z, each + count * (z + 1)]) for z in range(2)])
            for each in (under, above)
        )
    raw = RawMesh(kind, points, cells, ["a", "b", "cap"], np.tile(np.repeat([0, 1, 2], 4), dim - 1))
    raw.interfaces["main"] = above, under
    with pytest.raises(RuptfxError, match=facts("'cap'.*no connection" if gap else rf"'cap'.*{3 ** (dim - 1)} nodes")):
        distribute(COMM, Given(raw))
    raw.interfaces["other"] = (above + 9, under + 9)  # now all are connected
    distribute(COMM, Given(raw), sliding=["other"])


def test_an_interface_may_end_inside(shared_tmp_path: Path) -> None:
    """Welded beyond x = 0: the end has one node and is no point, the weights of the others are those of the whole."""
    half, whole = (points(shared_tmp_path, TWO, {"main": lines}, "upper", "lower", dim=2) for lines in ("11", "11, 21"))
    # 3 elements of order 2 on each side of x = 0: nodes 0 to 5, the end would be number 6.
    assert len(half) == 6 and len(whole) == 13
    np.testing.assert_allclose(half, whole[:6], rtol=1e-12, atol=1e-15)


def test_welded_blocks_in_3d(shared_tmp_path: Path) -> None:
    """6 x 2 hexahedra of order 2 on each side, 13 x 5 nodes: in two parts, and ending at x = 0."""
    lower, upper = "block_1, block_2", "block_3, block_4"
    four = dict(zip("abcd", (lower + ", " + upper).split(", "), strict=True))
    given = [
        ({"lower": lower, "upper": upper}, {"main": "top_1, top_2"}, "upper", "lower"),
        (four, {"west": "top_1", "east": "top_2"}, ["c", "d"], ["a", "b"]),
        ({"lower": lower, "upper": upper}, {"main": "top_1"}, "upper", "lower"),
    ]
    whole, parts, half = (points(shared_tmp_path, *mesh, dim=3) for mesh in given)
    assert len(whole) == 13 * 5 and whole[:, 3].sum() == pytest.approx(12e-3 * 3e-3, rel=1e-12)
    np.testing.assert_allclose(parts, whole, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(half, whole[: 6 * 5], rtol=1e-12, atol=1e-15)


def test_edges_of_two_bodies_at_the_same_place(shared_tmp_path: Path) -> None:
    """Both sides of a creeping part are edges of their own body: 4 elements of order 2, 9 nodes each."""
    file = shared_tmp_path / "creeping.geo"
    on_root(lambda: file.write_text(CREEPING))
    table = plates({
        "order": 2, "mesh": {"kind": "gmsh_file", "file": str(file),
                             "interfaces": {"main": {"plus": "upper", "minus": "lower"}}},
    })  # fmt: skip
    model = Model(parse_case(table))
    for edge, count in (("upper.creep", 9), ("lower.creep", 9), ("upper.left", 5), ("lower.left", 5)):
        nodes = Edge(model, edge, "edge").nodes
        nodes = nodes[nodes < model.owned_nodes]
        body = np.full(len(nodes), model.bodies.names.index(edge.partition(".")[0]))
        np.testing.assert_array_equal(model.layout.body[nodes], body)
        assert parallel.total(COMM, len(nodes)) == count


CROSSING = {"main": "11, 21", "across": "31, 41"}
SIDES = {"main": {"plus": ["c", "d"], "minus": ["a", "b"]}, "across": {"plus": ["b", "d"], "minus": ["a", "c"]}}


def test_a_branch_on_each_side(shared_tmp_path: Path) -> None:
    """The halves of a crossing interface under two names end at the main one: it has the points of an uncut one."""
    whole = points(shared_tmp_path, TWO, {"main": "11, 21"}, "upper", "lower", dim=2)
    for first in (True, False):
        lines = {"main": "11, 21", "below": "31", "above": "41"}
        sides = {"main": SIDES["main"], "below": {"plus": "b", "minus": "a"}, "above": {"plus": "d", "minus": "c"}}
        mesh = on_root(lambda: blocks(shared_tmp_path, FOUR, lines, {}))  # noqa: B023
        parts = distribute(COMM, GmshFile(file=mesh["file"], interfaces=dict(sorted(sides.items(), reverse=first))))
        nodes = Nodes(fem.lagrange(parts.mesh, 2, 2), parts)
        face = build_interface(nodes, "main")
        frame = face.frame.reshape(len(face.plus), 4)
        rows = parallel.share_rows(COMM, np.column_stack([face.points, face.weight, frame])[face.owned])
        np.testing.assert_allclose(rows[np.lexsort(np.round(rows[:, :2], 9).T[::-1])], whole, rtol=1e-12, atol=1e-15)
        # 3 elements of order 2 each, of which the last node is welded.
        assert [build_interface(nodes, name).total for name in ("below", "above")] == [6, 6]


@pytest.mark.parametrize(
    "bodies, lines, sides, message",
    [
        (FOUR, CROSSING, SIDES,
         r"interface 'across' and 'main' at \(0, 0\) m: more than two sides meet.*where two cross, give the halves"),
        (FOUR, {"west": "11", "east": "21", "above": "41"},
         {"west": {"plus": "c", "minus": "a"}, "east": {"plus": "d", "minus": "b"},
          "above": {"plus": "d", "minus": "c"}},
         r"'above' and 'east' and 'west' at \(0, 0\) m: more than two sides meet.*where three end, give two of them"),
        (TWO, HALVES, {"west": {"plus": "upper", "minus": "lower"}, "east": {"plus": "lower", "minus": "upper"}},
         r"'east' and 'west' at \(0, 0\) m: plus is there what is minus in the other; swap"),
        (FOUR, {"main": "11, 21"}, {"main": {"plus": "c", "minus": ["a", "b"]}},
         r"interface 'main' has 3 facets that are not between plus \(c\) and minus \(a, b\), .*on '[bd]' and '[bd]'"),
        (TWO, {"main": "11", "upper.creep": "21"}, {"main": {"plus": "upper", "minus": "lower"}},
         r"edge 'upper.creep' has 3 facets .* between '(upper|lower)' and '(upper|lower)', which share its nodes"),
        (TWO, {"main": "11", "outer": "12, 30", "left": "30"}, {"main": {"plus": "upper", "minus": "lower"}},
         r"the facet at \(.*\) m belongs to 'left' and 'outer'|belongs to '(top|outer)' and '(top|outer)'"),
        (TWO, {"main": "11"}, {"main": {"plus": ["upper", "lower"], "minus": "lower"}},
         r"no body can be on both sides, plus \(upper, lower\) and minus \(lower\)"),
    ],
)  # fmt: skip
def test_what_is_refused(bodies: Any, lines: Any, sides: Any, message: str, shared_tmp_path: Path) -> None:
    mesh = on_root(lambda: blocks(shared_tmp_path, bodies, lines, sides))
    with pytest.raises(RuptfxError, match=facts(message)):
        distribute(COMM, GmshFile(file=mesh["file"], interfaces=mesh["interfaces"]))
