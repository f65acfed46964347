"""A branch that ends on a fault: the same as no branch where it does not slip, mirrored, and without loss of energy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import Given, branched

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import RawMesh
from ruptfx.bodies.meshes.branched_fault import BranchedFault
from ruptfx.bodies.meshes.extruded import Extruded
from ruptfx.bodies.space.bodies import check_pairs, distribute
from ruptfx.bodies.space.branches import weld_branch_ends
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.case import parse_case, read_case
from ruptfx.interfaces.faults.interface import build_interface
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

STEPS = 600
DEMO = Path(__file__).parents[2] / "demos" / "branched_fault.toml"
STIFF_SPRINGS = {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}
BONDED = {"faults.branch.friction.mu_s": 1e6}
OPPOSITE = {f"faults.{name}.initial_stress.shear.{key}": -value for name, extra in (("main", 0.9e6), ("branch", 0.0))
            for key, value in (("inside", 3e6 + extra), ("outside", 3e6))}  # fmt: skip


def source(**changes: Any) -> BranchedFault:
    table = branched()["mesh"] | changes
    return BranchedFault.model_validate({key: value for key, value in table.items() if key != "kind"})


def run(table: dict[str, Any], mesh: Given | None = None) -> tuple[Model, Any, dict[str, float]]:
    parsed = parse_case(table)
    parsed = parsed if mesh is None else parsed.substituted({"mesh": mesh})
    model = Model(parsed)
    motion, state = parsed.stepper.bind(model), model.initial_state()
    for _ in range(STEPS):
        motion.step(state)
    return model, state, motion.energies(state)


def unbranched(raw: RawMesh) -> RawMesh:
    """The same mesh with both sides of the branch on one node everywhere."""
    plus, minus = raw.interfaces.pop("branch")
    number = np.arange(len(raw.points))
    for a, b in zip(plus.ravel(), minus.ravel(), strict=True):
        number[number == number[b]] = number[a]
    kept, number = np.unique(number, return_inverse=True)
    raw.points, raw.cells = raw.points[kept], number[raw.cells]
    raw.edges = {name: number[facets] for name, facets in raw.edges.items()}
    raw.interfaces = {name: (number[p], number[m]) for name, (p, m) in raw.interfaces.items()}
    return raw


def close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.fixture(scope="module")
def slipping() -> tuple[Model, Any, dict[str, float]]:
    return run(branched())


def slip(of: tuple[Model, Any, dict[str, float]], name: str) -> np.ndarray:
    return np.asarray(of[1].faults[name]["slip"])


@pytest.mark.parametrize("contact", [None, STIFF_SPRINGS], ids=["split_node", "compliant"])
def test_a_bonded_branch_is_no_branch(contact: dict[str, Any] | None, slipping: Any) -> None:
    """The fault slips at the junction as without a branch; where the branch slips, it slips differently."""
    table = branched(BONDED | ({} if contact is None else {"faults.main.contact": contact}))
    bonded = run(table)
    assert np.abs(slip(bonded, "branch")).max() == 0
    del table["faults"]["branch"]
    without = run(table, Given(unbranched(source().build())))
    face, same = (found[0].faults[0].interface for found in (bonded, without))
    np.testing.assert_allclose(face.weight, same.weight, rtol=1e-10)
    np.testing.assert_allclose(face.frame, same.frame, atol=1e-12)
    junction = np.abs(face.position) < 1e-9
    assert junction.sum() == 1 and slip(without, "main")[junction] > 5e-6
    for name in ("slip", "shear_traction", "normal_stress"):
        close(bonded[1].faults["main"][name], without[1].faults["main"][name])
    if contact is None:
        assert np.abs(slip(slipping, "main") - slip(without, "main")).max() > 0.05 * slip(without, "main").max()


def test_branch_and_fault_rupture_without_loss_of_energy(slipping: Any) -> None:
    """The front reaches the junction and goes on along both; energy closes, and the branch is welded at its end."""
    model, state, energy = slipping
    faces = {fault.name: fault.interface for fault in model.faults}
    for name in ("main", "branch"):
        assert np.isfinite(state.faults[name]["rupture_time"][faces[name].position > 1.5e-3]).mean() > 0.9
    start = faces["branch"].points[np.argmin(faces["branch"].position)]
    assert 1e-4 < np.linalg.norm(start) < 5e-4  # the second node: the first has no jump
    assert faces["branch"].line.first == 0 and faces["branch"].line.length == pytest.approx(5e-3)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    assert abs(lost) < 1e-10 * energy["frictional_dissipation"]


COARSE = {"order": 2, "mesh.element_size": 1e-3, "duration": 6e-6}
SPRINGS = {"kind": "compliant", "C_n": 2e14, "C_s": 1e14}
RIGID = {"kind": "split_node"}


def rupture(stepper: dict[str, Any], contact: dict[str, Any], changes: dict[str, Any] | None = None) -> Any:
    """The slip of both interfaces after the coarse run, and the relative error of its budget."""
    alike = {f"faults.{name}.contact": contact for name in ("main", "branch")}
    given = parse_case(branched({**COARSE, **alike, "stepper": stepper, **(changes or {})}))
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration * (1 - 1e-9):
        motion.step(state)
    energy = motion.energies(state)
    lost = (2 * energy["boundary_work"] - sum(energy.values())) / energy["boundary_work"]
    return {name: np.array(fields["slip"]) for name, fields in state.faults.items()}, abs(lost)


@pytest.mark.parametrize("contact, implicit", [(SPRINGS, SPRINGS), (RIGID, {"kind": "augmented_lagrangian"})],
                         ids=["compliant", "rigid"])  # fmt: skip
def test_steps_of_other_kinds(contact: dict[str, Any], implicit: dict[str, Any]) -> None:
    """Generalized-alpha finds the slip of leapfrog to 1 % (with half of its step 0.3 %), hybrid the same bits.

    Rupture begins at once, and hybrid takes explicit steps from then on. Average acceleration conserves the energy.
    """
    reference, lost = rupture({"kind": "leapfrog"}, contact)
    assert lost < 1e-12 and reference["branch"].max() > 2.5e-6
    slow, lost = rupture({"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": 1e-7}, implicit)
    assert lost < 1e-9
    fast, lost = rupture({"kind": "hybrid"}, contact)
    assert lost < 1e-12
    for name, slip in reference.items():
        assert np.linalg.norm(slow[name] - slip) < 0.015 * np.linalg.norm(slip)
        np.testing.assert_array_equal(fast[name], slip)


@pytest.mark.parametrize("contact", [SPRINGS, RIGID], ids=["compliant", "rigid"])
def test_slow_loading_until_fault_and_branch_rupture(contact: dict[str, Any]) -> None:
    """The edges move at 1 mm/s until a patch of the fault is unstable, after 50 us; the budget is closed throughout."""
    edges = [("plus.top", "x", 1e-3), ("plus.top", "y", 0.0), ("minus.bottom", "x", 0.0), ("minus.bottom", "y", 0.0)]
    patches = {
        f"faults.{name}.initial_stress.shear.inside": shear for name, shear in (("main", 3.59e6), ("branch", 3e6))
    }
    slips, lost = rupture({"kind": "hybrid"}, contact, {**patches, "duration": 6.2e-5, "boundaries": [
        {"kind": "driven", "edge": edge, "component": component, "velocity": speed} for edge, component, speed in edges
    ]})  # fmt: skip
    assert lost < 1e-9
    assert slips["main"].max() > 4e-6 and slips["branch"].max() > 1e-6


def test_mirrored_branch(slipping: Any) -> None:
    """A branch that points up under the opposite shear: mirrored displacement and slip."""
    mirrored = run(branched({"mesh.angle": 35.0, **OPPOSITE}))
    for name in ("main", "branch"):
        close(slip(mirrored, name), -slip(slipping, name))
        close(mirrored[1].faults[name]["normal_stress"], slipping[1].faults[name]["normal_stress"])
    fields = []
    for sign, (model, state, _) in ((1, slipping), (-1, mirrored)):
        rows = np.column_stack([model.coordinates, state.displacement.reshape(-1, 2)]) * (1, sign, 1, sign)
        _, place = np.unique(np.round(rows[:, :2] / 1e-9).astype(int), axis=0, return_inverse=True)
        # Both nodes of a point change sides.
        total = np.stack([np.bincount(place.ravel(), column) for column in rows.T], axis=1)
        fields.append(total / np.bincount(place.ravel())[:, None])
    np.testing.assert_allclose(fields[1][:, :2], fields[0][:, :2], atol=1e-12)
    close(fields[1][:, 2:], fields[0][:, 2:])


def slip_times(element_size: float) -> dict[str, np.ndarray]:
    """Times at which the slip of the demo reaches 0.2 m, every kilometre from the junction on."""
    parsed = read_case(DEMO, overrides=[f"mesh.element_size={element_size}", "duration=7.0"])
    model = Model(parsed)
    motion, state = parsed.stepper.bind(model), model.initial_state()
    found = {fault.name: np.full(len(fault.interface.plus), np.nan) for fault in model.faults}
    while state.time < parsed.duration:
        motion.step(state)
        for name, times in found.items():
            times[np.isnan(times) & (state.faults[name]["slip"] > 0.2)] = state.fault_time
    stations = np.arange(1e3, 11.1e3, 1e3)
    return {fault.name: np.interp(stations, fault.interface.position, found[fault.name]) for fault in model.faults}


@pytest.mark.slow
def test_fronts_of_the_demo_go_on_along_both_and_converge() -> None:
    """Below the Rayleigh speed, 3.18 km/s, on the fault and the branch; 1000 m against 500 m: 0.1 s."""
    coarse, fine = slip_times(1000.0), slip_times(500.0)
    for name in ("main", "branch"):
        assert np.abs(coarse[name] - fine[name]).max() < 0.1
        speed = 10e3 / np.ptp(fine[name])
        assert 2.7e3 < speed < 3184.0
        assert np.all(np.diff(fine[name]) > 0)


@pytest.mark.parametrize("first", ["main", "branch"])
@pytest.mark.parametrize("angle", [-35.0, 35.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_areas_at_the_junction(dim: int, angle: float, first: str) -> None:
    """Every point of the fault has its own area and normal whichever is listed first; the branch lacks its ends."""
    flat = source(angle=angle)
    raw = (flat if dim == 2 else Extruded(section=flat, thickness=2e-3, layers=2)).build()
    raw.interfaces = {name: raw.interfaces[name] for name in sorted(raw.interfaces, reverse=first == "main")}
    assert next(iter(raw.interfaces)) == first
    parts = distribute(fem.MPI.COMM_SELF, Given(raw))
    nodes = Nodes(fem.lagrange(parts.mesh, 2, dim), parts)
    faces = {name: build_interface(nodes, name) for name in raw.interfaces}
    depth, layers = (1.0, 1) if dim == 2 else (2e-3, 5)
    # 7 + 7 elements of order 2 and 5: the ends of both are welded.
    assert faces["main"].total == (2 * 14 - 1) * layers and faces["branch"].total == (2 * 6 - 1) * layers
    # Simpson's rule: a sixth of an element at an end.
    assert faces["main"].weight.sum() == pytest.approx((14e-3 - 1e-3 / 3) * depth, rel=1e-9)
    assert faces["branch"].weight.sum() == pytest.approx((5e-3 - 5e-3 / 6 / 3) * depth, rel=1e-9)
    normal = {"main": [0, 1], "branch": [-np.sin(np.deg2rad(angle)), np.cos(np.deg2rad(angle))]}
    for name, face in faces.items():
        expected = np.broadcast_to(normal[name] + [0] * (dim - 2) if name == "main" else [*normal[name], 0][:dim],
                                   face.frame[:, 0].shape)  # fmt: skip
        np.testing.assert_allclose(face.frame[:, 0], expected, atol=1e-9)
    at_junction = np.abs(faces["main"].points[:, 0]) < 1e-9
    assert at_junction.sum() == layers
    assert len(np.intersect1d(faces["main"].nodes, faces["branch"].nodes)) == 0


def test_crossing_and_three_ends_are_refused() -> None:
    """Two interfaces that cross; and three that end at one point, of which none goes on."""
    raw = source().build()
    plus, minus = raw.interfaces["main"]
    left = raw.points[plus].mean(axis=1)[:, 0] < 0
    raw.interfaces["west"], raw.interfaces["east"] = (plus[left], minus[left]), (plus[~left], minus[~left])
    del raw.interfaces["main"]
    with pytest.raises(RuptfxError, match=facts(r"'branch' and 'east' and 'west' at \(0, 0\) m: more than two sides")):
        check_pairs(weld_branch_ends(raw))


@pytest.mark.parametrize("changes, message", [
    ({"angle": 10.0}, r"angle = 10 degrees: must be 20 to 160"),
    ({"junction": 5e-3}, r"junction = 0.005 m: the branch begins on the fault, at least two elements from its ends"),
    ({"branch_length": 1e-3}, r"branch_length = 0.001 m: must be at least two elements; make element_size at most"),
])  # fmt: skip
def test_geometry_that_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=facts(message)):
        source(**changes)
