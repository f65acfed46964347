"""The facets of a mesh, and tables of fracture that cannot be used."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import GRANITE, NEVER, RUBS, WEAK, block, case

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem


def test_facets_of_a_square_cut_in_four() -> None:
    """2 x 2 mm of squares of 1 mm, each cut along a diagonal: 4 diagonals of sqrt(2) mm and 4 sides of 1 mm inside."""
    model = Model(case({"mesh.width": 2e-3, "mesh.height": 2e-3, "mesh.turn": 0.0, "boundaries": []}))
    net, cracks = model.cracks.network, model.cracks
    np.testing.assert_allclose(np.sort(net.length), [1e-3] * 4 + [np.sqrt(2) * 1e-3] * 4, rtol=1e-12)
    assert net.area == pytest.approx(4e-6, rel=1e-12)
    assert cracks.length_per_area == pytest.approx((4 + 4 * np.sqrt(2)) * 1e-3 / 4e-6, rel=1e-12)
    assert np.all(np.diff(net.vertices[:, 0] * 9 + net.vertices[:, 1]) > 0)  # sorted, each once
    # Corners of both sides are at the ends, and the normal leads from the one cell to the other.
    for side in (0, 1):
        np.testing.assert_allclose(model.coordinates[net.corners[:, side]], net.ends, atol=1e-15)
    centre = model.coordinates[model.space.dofmap.list].mean(axis=1)
    across = centre[net.cells[:, 1]] - centre[net.cells[:, 0]]
    assert np.all(np.sum(across * net.normal, axis=1) > 0)
    np.testing.assert_allclose(np.linalg.norm(net.normal, axis=1), 1, rtol=1e-14)


@pytest.mark.parametrize("changes, said", [
    ({"fracture.pairs": {"rock-stone": {"friction": RUBS}}},
     r"fracture.pairs.rock-stone: no such pair of bodies, did you mean 'rock-rock'\?"),
    ({"mesh.divide": 5e-3, "fracture.pairs": {"upper-lower": {"friction": RUBS}}, "boundaries": []},
     "fracture.pairs.upper-lower: write it in the order of the alphabet, 'lower-upper'"),
    ({"fracture.pairs": {"rock": {"friction": RUBS}}}, "fracture.pairs.rock = 'rock': a name has a letter first"),
    ({"fracture.stiffness_ratio": 2.0}, "fracture.stiffness_ratio = 2.0: input should be greater than or equal to 3"),
    ({"fracture.joints": {"old": {"friction": RUBS}}}, "fracture.joints.old: the mesh has no such joint"),
    ({"fracture.thickness": 0.0}, "fracture.thickness = 0.0: input should be greater than 0"),
    ({"fracture.default.cohesion": {**WEAK, "f_t": -1.0}}, "fracture.default.cohesion.f_t = -1.0: .* equal to 0"),
    ({"fracture.default.cohesion": {**WEAK, "kind": "linaer"}}, "unknown kind 'linaer', did you mean 'linear'"),
    ({"fracture.kind": "extrinsic", "fracture.default.friction": {"kind": "velocity_weakening", "mu_s": 0.6,
      "mu_d": 0.2, "V_w": 1.0}}, "depends on the slip rate or on time, .* take laws like coulomb"),
    ({"fracture.kind": "extrinsic", "fracture.default.friction": {"kind": "coulomb", "mu_d": {
      "kind": "gaussian", "background": 0.6, "amplitude": 0.1, "center": 0.0, "width": 1e-3}}},
     "fracture.default.friction.mu_d = .*: varies, and facets"),
    ({"fracture": {"kind": "extrinsic", "check_every": 0, "default": {"friction": RUBS}}},
     "fracture.check_every = 0: input should be greater than or equal to 1"),
    ({"fracture": {"kind": "extrinsic", "stiffness_ratio": 10.0, "default": {"friction": RUBS}}},
     "fracture: unknown key 'stiffness_ratio'"),
    ({"order": 2}, r"order = 2: with \[fracture\] the cells are of order 1"),
    ({"plane": "antiplane", "boundaries": []}, "plane = 'antiplane': bodies break in plane stress and plane strain"),
    ({"fracture.kind": "extrinsic", "stepper": {"kind": "generalized_alpha"}},
     "stepper.kind = 'generalized_alpha': fracture.kind = 'extrinsic' inserts facets in explicit steps"),
    ({"stepper": {"kind": "quasi_dynamic"}}, "stepper.kind = 'quasi_dynamic': bodies do not break in its steps"),
    ({"mesh": {"kind": "two_plates", "length": 12e-3, "height": 4e-3, "element_size": 2e-3}, "boundaries": []},
     "fracture: bodies break along triangles, and this mesh has quadrilaterals"),
    ({"fracture.stiffness_ratio": 3.0}, "fracture.stiffness_ratio = 3: the springs have .* at most 50% can be"),
    ({"damping": {"kelvin_voigt": {"thickness": 1e-3}}}, "damping.kelvin_voigt.thickness: bodies that break"),
])  # fmt: skip
def test_what_cannot_be_used_is_refused_by_name(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=facts(said)):
        Model(case(changes))


def test_check_says_what_the_mesh_resolves() -> None:
    """E G / f_t^2 over a mean facet of 1.1 to 1.2 mm: 62.5 mm is well resolved, 62.5 um is not, unless one knows."""

    def rows(**law: float) -> dict[str, Any]:
        table = block({"fracture.default.cohesion": {**WEAK, **law}, "duration": 1e-6})
        table["fracture"]["unresolved"] = law["G_Ic"] == 0.0200001
        return {row.quantity: row for row in preflight(parse_case(table))}

    name = "fracture rock-rock: process zone I"
    fine, lost, known = rows(G_Ic=20.0)[name], rows(G_Ic=0.02)[name], rows(G_Ic=0.0200001)[name]
    assert (fine.verdict, lost.verdict, known.verdict) == ("ok", "error", "warning")
    assert 50 < fine.value < 60 and lost.value == pytest.approx(1e-3 * fine.value) and "refine" in lost.note
    assert fine.note.startswith("0.0625 m")


def test_check_says_how_stiff_cells_and_how_soft_springs_are() -> None:
    """Springs of 10 E / h make a body softer by q E' / (1 + q E'), q = S / (2 k), or its cells stiffer."""
    name = "fracture rock: stiffness of cells"
    found = {}
    for compensate in (True, False):
        given = case({"fracture.compensate": compensate, "duration": 1e-6})
        found[compensate] = next(row for row in preflight(given) if row.quantity == name)
    stiffer, softer = found[True], found[False]
    assert softer.value == 50e9 and stiffer.value > 1.05 * 50e9
    assert stiffer.note.startswith(f"+{100 * (stiffer.value / 50e9 - 1):.1f}%") and stiffer.verdict == "ok"
    cracks = Model(case()).cracks
    q = cracks.length_per_area / (2 * 10 * 50e9 / cracks.edge) * 50e9 / (1 - 0.25**2)
    assert f"softer by about {100 * q / (1 + q):.1f}%" in softer.note and softer.verdict == "warning"


def test_check_says_how_fast_loading_is() -> None:
    """f_t / (rho c_p v), of edges and of bodies that fly, with the softer body of a pair; Rayleigh waves of none."""

    def rows(changes: dict[str, Any]) -> dict[str, Any]:
        found = {row.quantity: row for row in preflight(case({"duration": 1e-6, **changes}))}
        assert not any("generalized Rayleigh" in name for name in found)
        return found

    name, impedance = "fracture: passages of waves until f_t", np.sqrt(2600 * 60e9)  # lambda + 2 G = 1.2 E
    driven = rows({})[name]
    assert driven.value == pytest.approx(4e6 / (impedance * 3.0), rel=1e-12) and "first wave alone" in driven.note
    steel = {**GRANITE, "young_modulus": 200e9}
    flying = rows({"mesh.divide": 5e-3, "boundaries": [], "large_rotations": True, "materials.upper": steel,
                   "fracture.pairs": {"upper-upper": {"cohesion": NEVER, "friction": RUBS}},
                   "initial_velocity": {"upper": [0.03, -0.04]}})[name]  # fmt: skip
    assert flying.value == pytest.approx(4e6 / (impedance * 0.05), rel=1e-12) and "slow" in flying.note
    assert name not in rows({"boundaries": []})


def test_check_says_how_far_waves_go_between_two_looks_at_the_strength() -> None:
    """Nothing about springs, which are not there; 40 steps are too many."""

    def rows(every: int) -> dict[str, Any]:
        given = {"kind": "extrinsic", "check_every": every, "default": {"cohesion": WEAK, "friction": RUBS}}
        return {row.quantity: row for row in preflight(case({"fracture": given, "duration": 1e-6}))}

    name = "fracture: distance of a wave between two checks of the strength"
    often, seldom = rows(1), rows(40)
    assert often[name].verdict == "ok" and seldom[name].verdict == "warning"
    assert seldom[name].value == pytest.approx(40 * often[name].value)
    assert "reduce fracture.check_every" in seldom[name].note
    assert not any("stiffness of cells" in quantity for quantity in often)


def in_equilibrium(model: Model) -> np.ndarray:
    """Displacement of all nodes under the loads of a case whose springs have not yielded, shape (nodes, 2) [m]."""
    from scipy.sparse.linalg import LinearOperator, cg

    def stiff(u: np.ndarray) -> np.ndarray:
        u = np.ascontiguousarray(u.ravel())
        force = model.internal_force(u)
        model.cracks.add_spring_force(u, force)
        return -force + 1e-9 * model.mass * u  # without it rigid motion would cost nothing

    size = len(model.mass)
    u, failed = cg(LinearOperator((size, size), stiff, dtype=float), model.loads.force(1.0), rtol=1e-10)
    assert not failed
    return np.asarray(u.reshape(-1, 2))


def test_tractions_of_springs_scatter_on_an_irregular_mesh() -> None:
    """Under uniaxial stress the normal traction at an end should be that stress times n_y^2. The page on cracks gives
    its scatter on a Delaunay mesh: 3 % of the stress rms, and 15 % at most on these 1000 facets."""
    pytest.importorskip("gmsh")
    mesh = {**IRREGULAR, "shape": {"kind": "rectangle", "width": 16e-3, "height": 16e-3}}
    loads = [{"kind": "traction", "edge": f"specimen.{side}", "traction": [0.0, sign * 1e6]}
             for side, sign in (("top", 1), ("bottom", -1))]  # fmt: skip
    model = Model(case({"mesh": mesh, "fracture.default.cohesion": NEVER, "boundaries": loads}))
    cracks, moved = model.cracks, in_equilibrium(model)
    jump = moved[cracks.corners[:, 1]] - moved[cracks.corners[:, 0]]  # [facet, end]
    traction = cracks.stiffness[:, None] * np.einsum("fec,fc->fe", jump, cracks.normal)
    error = traction / 1e6 - cracks.normal[:, 1:] ** 2
    assert 900 < len(error) < 1100
    assert np.sqrt(np.mean(error**2)) == pytest.approx(0.033, abs=0.005)
    assert np.abs(error).max() == pytest.approx(0.15, abs=0.03)


def test_compensated_springs_leave_the_moduli_alone() -> None:
    """A patch of cells and springs under uniform stress: mean strain as the case has it, in both directions.

    The static equilibrium of free corners, solved with the operator: stress sigma on two sides gives strains
    sigma (1 - nu^2) / E and -sigma nu (1 + nu) / E in plane strain.
    """
    changes = {"mesh.width": 16e-3, "mesh.height": 16e-3, "fracture.default.cohesion": NEVER, "boundaries": [
        {"kind": "traction", "edge": "rock.top", "traction": [0.0, 1e6]},
        {"kind": "traction", "edge": "rock.bottom", "traction": [0.0, -1e6]},
    ]}  # fmt: skip
    found = {}
    for compensate in (True, False):
        model = Model(case({**changes, "fracture.compensate": compensate}))
        moved, x = in_equilibrium(model), model.coordinates
        sides = ((1, 16e-3), (1, 0), (0, 0), (0, 16e-3))
        top, bottom, left, right = (moved[np.isclose(x[:, axis], at)].mean(axis=0)[axis] for axis, at in sides)
        found[compensate] = np.array([top - bottom, right - left]) / 16e-3
    expected = 1e6 / 50e9 * np.array([1 - 0.25**2, -0.25 * 1.25])
    # Corner cells that hang on one spring, and the border, make a part of a percent.
    np.testing.assert_allclose(found[True], expected, rtol=0.015)
    assert found[False][0] > 1.1 * expected[0]


def test_a_notch_is_a_crack_from_the_start() -> None:
    """A bar torn across the notch: its facets carry nothing, touch when pressed, and are no events."""
    pytest.importorskip("gmsh")
    mesh = {"kind": "specimen", "shape": {"kind": "rectangle", "width": 8e-3, "height": 8e-3}, "element_size": 1e-3,
            "notches": [[-4e-3, 0.0, 0.0, 0.0]]}  # fmt: skip
    given = case({"mesh": mesh, "boundaries": [], "fracture.default.cohesion": NEVER})
    model = Model(given)
    state, x = model.initial_state(), model.coordinates
    cracks, notch = model.cracks, state.cracks["damage"][:, 0] == 1
    ends = cracks.network.ends[cracks.order][notch]
    assert len(ends) == 4 and np.all(np.abs(ends[..., 1]) < 1e-12) and np.all(ends[..., 0] < 1e-9)
    above = np.zeros(model.nodes, dtype=bool)
    cells = model.space.dofmap.list
    above[cells] = (x[cells].mean(axis=1)[:, 1] > 0)[:, None]
    for moved, carries in ((1e-6, False), (-1e-6, True)):
        state.displacement.reshape(-1, 2)[above, 1] = moved
        cracks(state, model.mass, 0.0)
        assert np.all((state.cracks["normal_traction"][notch] < 0) == carries)
        state.force[:] = 0
    assert not np.isfinite(state.cracks["time_of_failure"]).any()
    with pytest.raises(CaseError, match=facts(r"mesh: it has notches or joints, .* add the table \[fracture\]")):
        Model(case({"mesh": mesh, "boundaries": [], "fracture": None}))


# -- pieces of stars -------------------------------------------------------------------------------------------------


def rigid(changes: dict[str, Any]) -> Model:
    given = {"fracture.kind": "extrinsic", "fracture.default.cohesion": NEVER, "boundaries": []}
    return Model(case(given | changes))


def parted(model: Model, facets: np.ndarray) -> np.ndarray:
    """First corner of the piece of every corner, when these facets have been inserted."""
    state = model.initial_state()
    state.cracks["time_of_yield"][facets] = 0.0
    assert model.cracks.adopt(state.cracks) or not len(facets)
    return model.cracks.leader


def pieces_at(model: Model, point: tuple[float, float]) -> int:
    here = np.all(np.isclose(model.coordinates, point, atol=1e-12), axis=1)
    return len(np.unique(model.cracks.leader[here]))


def test_a_star_falls_apart_with_its_second_cut() -> None:
    """2 x 2 squares cut along diagonals: eight facets meet in the middle, as many as there are cells."""
    model = rigid({"mesh.width": 2e-3, "mesh.height": 2e-3, "mesh.turn": 0.0})
    cracks = model.cracks
    ends = cracks.network.ends[cracks.order]
    middle = np.flatnonzero(np.isclose(ends, 1e-3, atol=1e-12).all(axis=2).any(axis=1))
    around = ends[middle].sum(axis=1) - 1e-3  # the other end
    angle = np.arctan2(*(around - 1e-3).T[::-1])
    middle = middle[np.argsort(angle)]
    assert len(middle) in (4, 8)
    expected = [1, 1, *range(2, len(middle) + 1)]
    for cuts, pieces in enumerate(expected):
        parted(model, middle[:cuts])
        assert pieces_at(model, (1e-3, 1e-3)) == pieces
    # A cut that ends at the border parts the corners there at once.
    straight = middle[np.isclose(angle[np.argsort(angle)], -np.pi / 2)]
    parted(model, straight)
    assert pieces_at(model, (1e-3, 0.0)) == 2 and pieces_at(model, (1e-3, 1e-3)) == 1
    parted(model, straight[:0])
    assert pieces_at(model, (1e-3, 0.0)) == 1


IRREGULAR = {"kind": "specimen", "shape": {"kind": "rectangle", "width": 8e-3, "height": 8e-3}, "element_size": 1e-3}


@pytest.mark.parametrize("mesh", [{}, {"mesh": IRREGULAR}], ids=["squares", "irregular"])
@pytest.mark.parametrize("part", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_pieces_are_what_tied_facets_connect(part: float, mesh: dict[str, Any]) -> None:
    """Any facets inserted, at stars of four to eight facets, against the components of a graph of corners."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    if mesh:
        pytest.importorskip("gmsh")
    model = rigid(mesh)
    around = np.bincount(model.cracks.network.vertices.ravel())
    assert set(np.unique(around)) >= ({5, 6, 7} if mesh else {4, 8})
    cracks, rng = model.cracks, np.random.default_rng(int(10 * part))
    inserted = rng.random(len(cracks.order)) < part
    leader = parted(model, np.flatnonzero(inserted)).astype(int)
    tied = cracks.corners[~inserted].transpose(1, 0, 2).reshape(2, -1)
    graph = coo_matrix((np.ones(tied.shape[1]), tuple(tied)), shape=(model.nodes,) * 2)
    count, label = connected_components(graph, directed=False)
    assert len(np.unique(leader)) == count
    assert len(np.unique(np.stack([leader, label], axis=1), axis=0)) == count
    assert np.array_equal(leader[leader], leader)
    # What pieces have together is what their corners have.
    values = rng.normal(size=2 * model.nodes)
    sums = np.empty_like(values)
    cracks.total(values, sums)
    expected = np.zeros((count, 2))
    np.add.at(expected, label, values.reshape(-1, 2))
    np.testing.assert_allclose(sums.reshape(-1, 2), expected[label], atol=1e-13)
