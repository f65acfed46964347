"""Faults beside facets that may break: slip of the fault, initial stress of facets, energy of cracks off the fault."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import BRITTLE, HERE, RUBS, SOFT, beside_branches, faulted
from helpers.small_cases import branched, march

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.mechanisms.tied_faults import TiedFaults
from ruptfx.run import stages
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem
RIGID = {"kind": "split_node"}
PATCH: dict[str, Any] = {
    "faults.main.nucleation": [{"kind": "overstress", "extra": {
        "kind": "boxcar", "inside": 2e6, "outside": 0.0, "center": 15e-3, "half_width": 3.5e-3}}],
    "stepper": {"kind": "leapfrog", "time_step": 5e-8},
}  # fmt: skip


def run(changes: dict[str, Any]) -> tuple[Any, Any, dict[str, float], float]:
    """Model, state, energies, and the relative error of their balance."""
    model, motion, state = march(parse_case(faulted(changes), HERE))
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    return model, state, energy, (work - sum(energy.values())) / abs(work)


@pytest.mark.parametrize("contact", [{"kind": "split_node"}, SOFT])
def test_facets_that_never_break_change_no_slip(contact: dict[str, Any]) -> None:
    """Facets have the stiffness of the body with `compensate`; what is left is the error of the mesh.

    At equal vertices the slip is within 2 % of that of the continuous body (1.3 % found, and with springs four times as
    stiff the same), ruptures arrive within a twentieth of the duration. Without compensation the springs add a sixth of
    the compliance, and the slip is 8 % larger.
    """
    given = {"faults.main.contact": contact, "mesh.element_size": 0.5e-3}
    whole, reference, _, _ = run({**given, "fracture": None})
    slips, times = {}, {}
    for compensated in (True, False):
        model, state, energy, error = run({**given, "fracture.compensate": compensated})
        fields = state.faults["main"]
        assert abs(error) < 1e-12 and energy["fracture"] == 0
        # Two points at every vertex but the outermost ones, each a quarter of a facet away from it.
        position = model.faults[0].interface.position
        middle = 0.5 * (position[1:-1:2] + position[2:-1:2])
        np.testing.assert_allclose(middle, whole.faults[0].interface.position[1:-1])
        slips[compensated], times[compensated] = (
            0.5 * (fields[name].ravel()[1:-1:2] + fields[name].ravel()[2:-1:2]) for name in ("slip", "rupture_time")
        )
    slip, time = (reference.faults["main"][name].ravel()[1:-1] for name in ("slip", "rupture_time"))
    assert slip.max() > 3e-6
    assert np.linalg.norm(slips[True] - slip) < 0.02 * np.linalg.norm(slip)
    assert np.linalg.norm(slips[False] - slip) > 0.03 * np.linalg.norm(slip)
    assert np.abs(times[True] - time).max() < 0.05 * 4e-6


@pytest.mark.parametrize("contact, least", [(SOFT, 2e-6), (RIGID, 1.5e-6)])
def test_tied_facets_beside_a_fault_are_the_continuous_body(contact: dict[str, Any], least: float) -> None:
    """Until a facet breaks the bodies are those without facets: equal slip, tractions and arrivals to round-off.

    A point of the continuous body has two ends of facets in its place, with the same initial stress: the patch of
    the nucleation ends in the middle of a facet.
    """
    given = {**PATCH, "faults.main.contact": contact}
    _, whole, reference, _ = run({**given, "fracture": None})
    _, tied, energy, error = run({**given, "fracture.kind": "extrinsic"})
    assert abs(error) < 1e-12 and energy["kinetic"] == pytest.approx(reference["kinetic"], rel=1e-12)
    expected, found = whole.faults["main"], tied.faults["main"]
    assert expected["slip"].max() > least and np.isfinite(expected["rupture_time"]).sum() > 10
    for name in ("slip", "slip_rate", "shear_traction", "normal_stress", "rupture_time"):
        # Two ends of every facet between two nodes.
        of_nodes = np.stack([expected[name][:-1], expected[name][1:]], axis=1).ravel()
        np.testing.assert_allclose(found[name], of_nodes, rtol=0, atol=1e-12 * np.nanmax(np.abs(of_nodes)))


def test_cut_cells_that_stick_beside_a_rigid_fault_are_the_continuous_body() -> None:
    """All facets are inserted from the start, without cohesion, and friction keeps them closed and stuck.

    At every vertex of the fault each cell moves by itself, so that the tractions of the fault and of the facets depend
    on each other. They are not unique, but slip and arrivals are those of the bodies without facets; 1e-7 found, with
    tractions that change by less than 1e-6 in the last sweep. The budget closes to rounding all the same.
    """
    given = {**PATCH, "faults.main.contact": RIGID}
    _, whole, _, _ = run({**given, "fracture": None})
    cut = {"kind": "extrinsic", "default": {"friction": {"kind": "coulomb", "mu_d": 20.0}}}
    model, state, _, error = run({**given, "fracture": cut})
    assert len(model.cracks.coupled) == len(model.cracks.coupling) == 62  # vertices on both sides
    assert abs(error) < 1e-12
    expected, found = whole.faults["main"], state.faults["main"]
    for name, least in (("slip", 1.5e-6), ("rupture_time", 1e-6)):
        of_nodes = np.stack([expected[name][:-1], expected[name][1:]], axis=1).ravel()
        assert np.nanmax(of_nodes) > least
        np.testing.assert_allclose(found[name], of_nodes, rtol=0, atol=1e-6 * np.nanmax(of_nodes))


@pytest.mark.parametrize("kind, contact, least", [
    ("intrinsic", RIGID, 15), ("extrinsic", SOFT, 15), ("extrinsic", RIGID, 10),
])  # fmt: skip
def test_a_rupture_breaks_facets_beside_the_fault(kind: str, contact: dict[str, Any], least: int) -> None:
    """What breaks is near the fault, on the side that the rupture extends, takes energy, and slows the slip by 1 %."""
    given = {"mesh.element_size": 0.5e-3, "faults.main.contact": contact, "fracture.kind": kind}
    whole = run(given)[1]
    model, state, energy, error = run({**given, "fracture.default.cohesion": BRITTLE})
    assert abs(error) < 1e-12
    cracks = model.cracks
    failed = (state.cracks["damage"] >= 1).all(axis=1)
    assert failed.sum() > least
    broken = cracks.network.ends[cracks.order][failed].mean(axis=1) - (15e-3, 10e-3)
    assert np.abs(broken[:, 1]).max() < 6e-3
    # The plus side moves along x: ahead of the right front it is compressed, and the minus side is extended.
    assert np.mean(broken[:, 0] * broken[:, 1] < 0) > 0.9
    # Facets that have failed took G_Ic at least, in shear G_IIc, per length.
    length = 2 * cracks.half_length[failed].sum()
    assert energy["fracture"] > BRITTLE["G_Ic"] * length
    assert np.mean(state.faults["main"]["slip"]) < 0.995 * np.mean(whole.faults["main"]["slip"])


def test_tied_facets_break_where_the_whole_stress_exceeds_their_strength() -> None:
    """The initial stress plus that of a uniform strain, on facets of all directions; tractions are sigma n."""
    given = faulted({"faults.main.contact": SOFT, "fracture.kind": "extrinsic", "fracture.default.cohesion": {
        **BRITTLE, "f_t": 0.2e6, "c": 0.5e6}})  # fmt: skip
    model = Model(parse_case(given, HERE))
    cracks, state = model.cracks, model.initial_state()
    strain = np.array([[6.4e-5, -0.5e-5], [-0.5e-5, 5e-5]])
    modulus, ratio = 50e9, 0.25
    first, second = modulus * ratio / (1 + ratio) / (1 - 2 * ratio), modulus / 2 / (1 + ratio)
    stress = np.array([[-10e6, 5.5e6], [5.5e6, -10e6]])
    stress += first * np.trace(strain) * np.eye(2) + 2 * second * strain
    state.displacement[:] = (model.coordinates @ strain).ravel()
    new = np.sort(cracks.grow(state, model.mass))
    traction = cracks.normal @ stress
    normal, shear = (np.sum(traction * axis, axis=1) for axis in (cracks.normal, cracks.tangent))
    breaks = (normal >= 0.2e6) | (np.abs(shear) >= 0.5e6 + RUBS["mu_d"] * np.maximum(-normal, 0))
    assert 0.02 < breaks.mean() < 0.9 and len(new)
    np.testing.assert_array_equal(np.isfinite(state.cracks["time_of_yield"]), breaks)
    for name, expected in (("normal_traction", normal), ("shear_traction", shear)):
        np.testing.assert_allclose(state.cracks[name], np.stack([expected] * 2, axis=1), rtol=0, atol=1e-4)


def test_facets_that_slide_from_the_start_close_the_budget() -> None:
    """Facets without cohesion under initial stress and a sudden traction: work of the first half step."""
    _, _, energy, error = run({
        "faults.main.contact": SOFT, "fracture.kind": "extrinsic", "duration": 1e-7,
        "fracture.default": {"friction": {"kind": "coulomb", "mu_d": 0.67}},
        "boundaries": [{"kind": "traction", "edge": "upper.top", "traction": [5e7, 0.0]}],
    })  # fmt: skip
    assert abs(error) < 1e-12 and energy["frictional_dissipation"] > 0.01 * energy["kinetic"]


@pytest.mark.parametrize("kind, contact", [("intrinsic", RIGID), ("extrinsic", SOFT), ("extrinsic", RIGID)])
def test_a_branched_fault_breaks_facets_without_loss_of_energy(kind: str, contact: dict[str, Any]) -> None:
    """A rupture that goes on along a branch, beside facets that break on both."""
    _, motion, state = march(parse_case(branched(beside_branches(kind, contact)), HERE))
    energy = motion.energies(state)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    assert abs(lost) < 1e-12 * energy["boundary_work"]
    assert (state.cracks["damage"] >= 1).all(axis=1).sum() > 5
    for name, least in (("main", 1e-5), ("branch", 4e-7)):
        assert state.faults[name]["slip"].max() > least
    assert np.isfinite(state.faults["branch"]["rupture_time"]).any()


def test_facets_begin_with_the_stress_of_the_bodies() -> None:
    """Before anything moves they carry sigma n, and exert nothing; then springs carry the change."""
    stress = np.array([[-10e6, 5.5e6], [5.5e6, -10e6]])
    model = Model(parse_case(faulted(), HERE))
    cracks, state = model.cracks, model.initial_state()
    for moves in (False, True):
        if moves:
            state.displacement[:] = np.random.default_rng(0).normal(size=len(state.displacement)) * 1e-9
        state.force[:] = 0
        cracks(state, model.mass, 1e-8)
        rows = state.displacement.reshape(-1, 2)
        jump = rows[cracks.corners[:, 1]] - rows[cracks.corners[:, 0]]
        traction = (cracks.normal @ stress)[:, None] + cracks.stiffness[:, None, None] * jump
        np.testing.assert_allclose(cracks.tractions(state.cracks), traction, rtol=1e-12, atol=1e-5)
        force = np.zeros_like(state.force).reshape(-1, 2)
        change = (cracks.weight * cracks.stiffness)[:, None, None] * jump
        np.add.at(force, cracks.corners[:, 0], change)
        np.subtract.at(force, cracks.corners[:, 1], change)
        np.testing.assert_allclose(state.force, force.ravel(), rtol=1e-9, atol=1e-9 * np.abs(traction).max() * 1e-3)
        work = cracks.preload_work(state.displacement)
        stored = 0.5 * np.sum(change * jump)
        # sigma n [u] + k [u]^2 / 2 of all ends.
        assert cracks.stored(state.cracks, 0 * state.displacement) - work == pytest.approx(stored, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("changes, said", [
    ({"fracture.default.cohesion": {**BRITTLE, "c": 1e5}, "fracture.default.friction.mu_d": 0.2},
     "initial_stress.tensor: the facet at .* of shear, more than its strength"),
    # 0.65 at V_0, below the largest 5.5 / sqrt(10^2 - 5.5^2) = 0.659 of shear over pressure; 0.72 at 1 mm/s.
    ({"fracture.default": {"friction": {
        "kind": "rate_and_state_ageing", "a": 0.01, "b": 0.012, "D_c": 1e-6, "f_0": 0.65, "V_0": 1e-6,
        "theta_initial": 1.0}}},
     "initial_stress.tensor: the facet at .* of shear, more than its strength"),
    ({"faults.main.initial_stress": {"normal": 5e6}}, "faults.main.initial_stress.normal: with .fracture. the facets"),
    ({"faults.main.sliding": {}}, "faults.main.sliding: with .fracture. interfaces join"),
])  # fmt: skip
def test_what_facets_cannot_carry_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=facts(said)):
        Model(parse_case(faulted(changes), HERE))


class WithAnotherRank:
    """A communicator of one rank that gathers the numbers of another one, too."""

    def __init__(self, comm: Any, other: Any) -> None:
        self._comm, self._other, self.gathered = comm, other, 0

    def allgather(self, own: Any) -> list[Any]:
        if not isinstance(own, list):
            return [own]
        self.gathered += 1
        return [own, self._other(own)]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._comm, name)


def test_sweeps_go_on_until_the_changes_of_all_ranks_are_small_beside_the_largest_traction() -> None:
    """Another rank that changes for ever, one whose tractions are a million times larger, and one like this."""
    cut = {"kind": "extrinsic", "default": {"friction": {"kind": "coulomb", "mu_d": 20.0}}}
    given = {**PATCH, "faults.main.contact": RIGID, "fracture": cut}
    sweeps, open_steps = {}, {}
    for name, other in {
        "alike": lambda own: own,
        "changes": lambda own: [1e30, own[1]],
        "large": lambda own: [0.0, 1e6 * own[1]],
    }.items():
        model = Model(parse_case(faulted(given), HERE))
        motion, state = stages.bind(model), model.initial_state()
        for _ in range(3):
            motion.step(state)
        (tied,) = (each for each in motion.mechanisms if isinstance(each, TiedFaults))
        tied.model = copy.copy(tied.model)
        tied.model.comm = comm = WithAnotherRank(model.comm, other)
        before = tied.unconverged
        motion.step(state)
        sweeps[name], open_steps[name] = comm.gathered, tied.unconverged - before
    assert open_steps == {"alike": 0, "changes": 1, "large": 0}
    assert 1 <= sweeps["large"] < sweeps["alike"] < sweeps["changes"]
