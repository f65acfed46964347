"""Interfaces that slide, with every contact method that can: J, patch test, matching meshes, budget, refusals."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import STIFF, rough, wave
from helpers.small_cases import HOMALITE, SPLIT, advance, case, march, plates, smooth_field, springs

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.reference_sliding import slide_reference

from ruptfx import RuptfxError
from ruptfx.bodies.operators.geometry import BOX, POINTWISE, _classify
from ruptfx.bodies.operators.ufl_form import UflForm
from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.bodies.state import FaultState
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import alternatives
from ruptfx.interfaces.mechanisms.sliding import SlidingFaults
from ruptfx.interfaces.mechanisms.stepped_nodes import masses_and_dashpots
from ruptfx.interfaces.sliding.follower import StepFollower
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

# Methods that slide by themselves: with equal springs, or with sweeps to round-off.
CONTACTS: dict[str, dict[str, Any]] = {}
for kind, cls in alternatives("ruptfx.laws.contact").items():
    sweeps = {"tolerance": 1e-12, "sweeps": 100} if "sweeps" in cls.offers else {}
    if cls.explicit and (cls.traction_ends_slip or sweeps):
        CONTACTS[kind] = {**springs(kind, 3e11), **sweeps}
every_contact = pytest.mark.parametrize("contact", CONTACTS)


def is_elastic(contact: str) -> bool:
    return "stiffness" in alternatives("ruptfx.laws.contact")[contact].offers


def test_contact_of_both_kinds_slides() -> None:
    assert {is_elastic(contact) for contact in CONTACTS} == {False, True}


@pytest.mark.parametrize("order", [2, 4])
def test_curved_elements_and_those_that_are_not(order: int) -> None:
    """The fast kernel agrees with the weak form, and takes elements away from the surfaces for the boxes they are."""
    model = Model(parse_case(rough({"order": order, "mesh.curve_order": order, "mesh.upper.height": 1e-3})))
    u, fast, exact = smooth_field(model), np.zeros(2 * model.nodes), np.zeros(2 * model.nodes)
    model.operator.add_internal_force(u, fast)
    UflForm(model.bulk).add_internal_force(u, exact)
    np.testing.assert_allclose(fast, exact, atol=1e-11 * np.abs(exact).max())
    # Three rows follow the surface on either side, of 10 and 4 rows of 12 and 18 elements.
    cells = np.arange(len(model.bodies.cell_body))[:, None]
    kinds = _classify(model.mesh, cells)
    assert np.sum(kinds == BOX) == 7 * 12 + 18 and np.sum(kinds == POINTWISE) > 80


# -- the jump ------------------------------------------------------------------------------------------------------


def test_exact_transpose_and_rigid_motion() -> None:
    """<W t, J u> = <J' W t, u>; a translation opens and slides nowhere, also on rough surfaces."""
    model = Model(parse_case(rough()))
    face, random = model.faults[0].interface, np.random.default_rng(2)
    u, t = random.normal(size=model.nodes * 2), random.normal(size=(face.total, 2))
    force = np.zeros_like(u)
    face.assemble(t, force)
    left = np.sum(face.weight[:, None] * t * face.rate(u))
    assert abs(left - force @ u) < 1e-13 * np.sum(np.abs(force * u))
    assert np.abs(face.rate(np.tile([2.0, 3.0], model.nodes))).max() < 1e-13
    # The normal goes from the minus (lower) to the plus body, the offset is the gap: crests touch at x = 0, 0.6 ...,
    # within a hundredth of their height on these elements
    assert face.frame[:, 0, 1].min() > 0.99
    gap = face.jump(np.zeros_like(u))[:, 0]
    crests = np.isclose(np.cos(2 * np.pi * face.points[:, 0] / 0.6e-3), 1, atol=1e-12)
    assert np.abs(gap[crests]).max() < 1e-7
    # ... and valleys are 4 A apart, where the elements are fine enough.
    np.testing.assert_allclose(gap[np.isclose(face.points[:, 0] % 0.6e-3, 0.3e-3)], 40e-6, rtol=1e-2)


@pytest.mark.parametrize("order", [1, 2, 4])
@every_contact
def test_uniform_stress_passes_between_different_meshes(contact: str, order: int) -> None:
    """Patch test: uneven elements, 16 on 11, uniform compression and shear on top of the initial stress."""
    added = np.array([[0.4e6, 0.7e6], [0.7e6, -2e6]])  # tension positive
    boundaries = []
    for edge, n in {"upper.top": (0, 1), "lower.bottom": (0, -1), "upper.left": (-1, 0), "lower.left": (-1, 0),
                    "upper.right": (1, 0), "lower.right": (1, 0)}.items():  # fmt: skip
        boundaries.append({"kind": "traction", "edge": edge, "traction": (added @ np.array(n, float)).tolist()})
    body = {"length": 8e-3, "height": 2e-3}
    mesh = {
        "kind": "rough_plates", "curve_order": 1, "upper": {**body, "element_size": 0.5e-3},
        "lower": {**body, "element_size": 8e-3 / 11},
    }  # fmt: skip
    loaded = case({
        "order": order, "mesh": mesh, "boundaries": boundaries, "duration": 1e-6, "faults.main.sliding": {},
        "faults.main.contact": CONTACTS[contact], "faults.main.friction": {"kind": "coulomb", "mu_d": 0.9},
    })  # fmt: skip
    model = Model(loaded)
    motion, state = loaded.stepper.bind(model), model.initial_state()
    E, nu = HOMALITE["young_modulus"], HOMALITE["poisson_ratio"]
    strain = ((1 + nu) * added - nu * np.trace(added) * np.eye(2)) / E  # Hooke's law in plane stress
    fields = state.displacement.reshape(-1, 2)
    fields[:] = model.coordinates @ strain
    if is_elastic(contact):  # it closes by T_n / C and shears by T_t / C: the upper body moves
        upper = np.unique(model.space.dofmap.list[model.bodies.cell_body == 0])
        fields[upper] += added[:, 1] / 3e11
    for _ in range(20):
        motion.step(state)
    assert np.abs(state.velocity).max() < 1e-10  # a wave of 2 MPa has 0.8 m/s
    fault = state.faults["main"]
    np.testing.assert_allclose(fault["normal_stress"], 8e6, rtol=1e-9)
    np.testing.assert_allclose(fault["shear_traction"], 0.7e6, rtol=1e-8)


@pytest.mark.parametrize("order, least", [(2, 3.5), (4, 7.0)])
def test_uniform_stress_passes_curved_surfaces(order: int, least: float) -> None:
    """Patch test on waves that fit: what the same stress leaves at the nodes of different elements vanishes with
    them; normals of curved surfaces are not polynomials, so that it is no round-off."""
    stress = np.array([[1e6, -0.4e6], [-0.4e6, -3e6]])
    E, nu = STIFF["young_modulus"], STIFF["poisson_ratio"]
    strain = (1 + nu) / E * (stress - nu * np.trace(stress) * np.eye(2))  # Hooke's law in plane strain
    left = []
    for size in (0.1e-3, 0.05e-3):
        shape = {"profile": {**wave(1), "mean": 0.0}, "length": 1.2e-3, "left": 0.0, "height": 0.5e-3}
        model = Model(parse_case(rough({
            "order": order, "mesh.curve_order": order, "boundaries": [], "materials": {"default": STIFF},
            "mesh.upper": {**shape, "element_size": size}, "mesh.lower": {**shape, "element_size": 0.75 * size},
        })))  # fmt: skip
        face = model.faults[0].interface
        force = model.internal_force((model.coordinates @ strain).ravel())
        traction = np.einsum("ikc,cd,id->ik", face.frame, stress, face.frame[:, 0])
        face.add_force(force, traction, scale=np.ones_like(force))
        inside = np.abs(model.coordinates[face.nodes, 0] - 0.6e-3) < 0.45e-3
        left.append(np.abs(force.reshape(-1, 2)[face.nodes[inside]]).max() / (3e6 * face.weight.max()))
    assert left[0] < 0.01 and left[0] / left[1] > least


@every_contact
@pytest.mark.parametrize("friction", ["coulomb", "prakash_clifton"])
def test_compiled_step_is_the_one_with_arrays(contact: str, friction: str) -> None:
    """From a moment when asperities stick, slide and are apart, and one end has slid off."""
    law = {"kind": "coulomb", "mu_d": 0.3}
    if friction == "prakash_clifton":
        law = {"kind": "prakash_clifton", "L_p": 1e-6, "law": law}
    table = rough({
        "faults.main.contact": CONTACTS[contact], "faults.main.friction": law, "mesh.lower.left": 0.15e-3,
        "faults.main.nucleation": {"kind": "overstress", "extra": 1e5},
    })  # fmt: skip
    new, face = steps_alike(table)
    closed = new["normal_stress"] > 0
    assert 0.1 < closed.mean() < 0.9 and not face.covered.all()


@every_contact
def test_compiled_step_with_cohesion_is_the_one_with_arrays(contact: str) -> None:
    """From a moment when a crack has grown from one end of two flat bodies: intact and damaged points."""
    flat = {"profile": {"kind": "constant", "value": 0.0}}
    weak = {"kind": "linear", "f_t": 2e6, "c": 4e6, "G_Ic": 10.0, "G_IIc": 40.0}
    new, _ = steps_alike(rough({
        "faults.main.contact": CONTACTS[contact], "faults.main.cohesion": weak, "duration": 0.5e-6,
        "mesh.upper": {"length": 1.2e-3, "height": 0.5e-3, "element_size": 0.1e-3, **flat},
        "mesh.lower": {"length": 2.4e-3, "height": 0.5e-3, "element_size": 0.137e-3, "left": -0.3e-3, **flat},
        "boundaries": [
            {"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"
        ] + [{"kind": "driven", "edge": "upper.left", "component": axis, "velocity": 20.0} for axis in "xy"],
    }))  # fmt: skip
    damage = new["damage"]
    assert np.any(damage < 1e-3) and np.any((damage > 0.1) & (damage < 1))
    assert new["normal_stress"].min() < -1e6


def steps_alike(table: dict[str, Any]) -> tuple[FaultState, SlidingInterface]:
    """Compare the next step at the end of a case, compiled and with arrays; fields and interface after it."""
    model, motion, state = march(parse_case(table))
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    compiled, field = sliding.steps[2][0], state.faults["main"]
    states = [{name: values.copy() for name, values in field.items()} for _ in range(2)]
    arrays = [(state.velocity.copy(), np.zeros_like(state.force)) for _ in range(2)]
    compiled(states[0], state.displacement, *arrays[0], state.time)
    mass, dashpot = masses_and_dashpots(model)
    inverse_mass = np.where(model.loads.prescribed, 0.0, 1 / (mass + 0.5 * motion.dt * dashpot))
    slide_reference(
        model.faults[0], states[1], state.displacement, *arrays[1], inverse_mass, compiled.clock, state.time,
        model.case.output.rupture_threshold,
    )  # fmt: skip
    new, face = states[0], model.faults[0].interface
    assert isinstance(face, SlidingInterface)
    for name, values in states[1].items():
        np.testing.assert_allclose(new[name], values, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(values)))
    for found, expected in zip(*arrays, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())
    return new, face


@every_contact
def test_matching_nodes_give_what_pairs_give(contact: str) -> None:
    """With a frozen pairing: split nodes, and compliant contact of pairs."""
    changes = {
        "duration": 6e-6, "faults.main.initial_stress.shear": 2e6,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.4, "mu_d": 0.1, "D_c": 1e-5},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0, "ramp": 2e-6}],
        "faults.main.nucleation": {"kind": "overstress", "extra": 0.2e6},
    }  # fmt: skip
    pairs, alone = CONTACTS[contact] if is_elastic(contact) else SPLIT, CONTACTS[contact]
    step = {"stepper": {"kind": "leapfrog", "time_step": 2e-8}}
    expected = march(case({**changes, **step, "faults.main.contact": pairs}))[2]
    frozen = {"faults.main.contact": alone, "faults.main.sliding": {"update_slip": 1e9}}
    found = march(case({**changes, **step, **frozen}))[2]
    assert expected.faults["main"]["slip"].max() > 1e-6
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-10 * np.abs(expected.velocity).max())
    for name in ("slip", "normal_stress", "shear_traction", "friction_work"):
        values = expected.faults["main"][name]
        np.testing.assert_allclose(found.faults["main"][name], values, atol=1e-10 * np.abs(values).max())
    for name, value in expected.energy.items():
        np.testing.assert_allclose(found.energy[name], value, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_rubbing_closes_the_budget(order: int) -> None:
    """Impacts, friction, updates of who faces whom: work of all forces is accounted for to round-off, and the share of
    the normal stress in it is small."""
    size = {"mesh.upper.element_size": 0.05e-3 * order, "mesh.lower.element_size": 0.07e-3 * order}
    table = rough({"order": order, "mesh.curve_order": order, "duration": 10e-6, "damping.mass": 1e5, **size})
    model, motion, state = march(parse_case(table))
    assert model.faults[0].interface.geometry.revision > 10
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert abs(work - sum(energy.values())) < 1e-11 * work
    assert energy["frictional_dissipation"] > 0.02 * work
    assert 0 < energy["impact_loss"] < 0.05 * energy["frictional_dissipation"]


def test_springs_that_rub_close_the_budget() -> None:
    """What springs hold changes when it is found again what they face; that is counted, and less the more often."""
    springs = {"faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}}
    taken = []
    for follow in (0.1, 0.02):
        table = rough({**springs, "faults.main.sliding.update_slip": follow, "duration": 8e-6, "damping.mass": 1e5})
        _, motion, state = march(parse_case(table))
        energy = motion.energies(state)
        work = energy.pop("boundary_work")
        assert abs(work - sum(energy.values())) < 1e-11 * work
        assert energy["frictional_dissipation"] > 0.02 * work and abs(energy["impact_loss"]) < 1e-3 * work
        taken.append(energy["pairing_update_loss"] / work)
    assert 1e-5 < abs(taken[1]) < 0.5 * abs(taken[0])  # a fifth to first order


def test_springs_carry_the_same_where_they_face_the_same() -> None:
    """What an update takes for the traction across what is faced now is that of the last step where nothing is new."""
    table = rough({"faults.main.contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}, "duration": 3e-6})
    model, motion, state = march(parse_case(table))
    names, fields = ("normal_stress", "shear_traction"), state.faults["main"]
    before = {name: fields[name].copy() for name in names}
    assert 0.1 < np.mean(before["normal_stress"] > 0) < 0.9
    model.faults[0].interface.geometry.slides = np.inf
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    sliding.followers[0]._stretch(state)
    for name in names:
        np.testing.assert_allclose(fields[name], before[name], atol=1e-9 * np.abs(before[name]).max())


def test_sweeps_that_do_not_converge_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    """The run goes on, with a budget that closes as well."""
    contact = {"kind": "forward_lagrange", "sweeps": 1}
    _, motion, state = march(parse_case(rough({"faults.main.contact": contact, "duration": 3e-6})))
    reported = [record.getMessage() for record in caplog.records if "contact.sweeps = 1" in record.getMessage()]
    assert 1 <= len(reported) <= 6 and "faults.main: tractions did not converge" in reported[0]
    energy = motion.energies(state)
    assert abs(energy.pop("boundary_work") / sum(energy.values()) - 1) < 1e-11


@pytest.mark.parametrize("started", [False, True])
def test_only_what_touches_ruptures(started: bool) -> None:
    """First slip or opening of a contact since ruptures count, or the case starts one; surfaces that never met have
    no rupture."""
    after = 1e-6
    drop = [{"kind": "friction_drop", "center": 0.6e-3, "half_width": 0.05e-3, "time": after}]
    given = parse_case(rough({"faults.main.nucleation": drop} if started else {"output.rupture_after": after}))
    expected, closed = np.full(0, np.nan), np.zeros(0, dtype=bool)

    def watch(state: Any) -> None:
        nonlocal expected, closed
        fault = state.faults["main"]
        if len(closed) == 0:
            expected, closed = np.full(len(fault["slip"]), np.nan), np.zeros(len(fault["slip"]), dtype=bool)
        was, closed = closed, fault["normal_stress"] > 0
        if state.fault_time >= after:
            event = np.where(closed, np.abs(fault["slip_rate"]) > 1e-3, was)
            expected = np.where(np.isnan(expected) & event, state.fault_time, expected)

    _, motion, state = march(given, watch=watch)
    found = state.faults["main"]["rupture_time"]
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    assert 0.05 < np.isfinite(found).mean() < 0.5 and np.nanmin(found) > after - motion.dt
    assert np.nanmax(np.abs(found - expected)) < 1.01 * motion.dt
    assert (np.abs(state.faults["main"]["slip_rate"][np.isnan(found)]) > 1e-3).any()


def test_large_strains_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    """Bodies that meet at 400 m/s, a fifth of the speed of their waves: once, with place and amount."""
    given = parse_case(rough({"boundaries": [], "duration": 1e-6}))
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    velocity, upper = state.velocity.reshape(-1, 2), model.layout.body == model.bodies.names.index("upper")
    velocity[upper] = [40.0, -4.0]
    advance(motion, state, 0.3e-6)
    assert not caplog.records
    velocity[upper] = [400.0, -400.0]
    advance(motion, state, 0.6e-6)
    said = [record.getMessage() for record in caplog.records]
    assert 1 <= len(said) <= 6 and "has strained or turned by 0." in said[0] and "must stay below some" in said[0]


def test_free_bodies_that_collide_keep_their_momentum() -> None:
    """No supports: the sum of m v, zero at first, stays zero; the shear of friction turns nothing either."""
    table = rough({"boundaries": [
        {"kind": "traction", "edge": edge, "traction": traction, "ramp": 1e-6}
        for edge, traction in (("upper.top", [5e6, -20e6]), ("lower.bottom", [-2.5e6, 10e6]))
    ]})  # fmt: skip
    model, _, state = march(parse_case(table))
    momentum = (model.mass * state.velocity).reshape(-1, 2)
    assert state.faults["main"]["normal_stress"].max() > 1e7
    # The edges are 1.2 and 2.4 mm long: the loads are in balance.
    assert np.abs(momentum.sum(axis=0)).max() < 1e-12 * np.abs(momentum).sum()


def test_bodies_that_meet_from_afar() -> None:
    """Too far apart to face each other at first; equal bodies then share the speed of the upper one, 20 m/s: the
    pressure is rho c 10 m/s = 25.7 MPa."""
    body = {"length": 0.4e-3, "height": 0.4e-3, "element_size": 0.1e-3}
    table = rough({
        "mesh": {"kind": "rough_plates", "curve_order": 1, "closest": 1.5e-3, "upper": body,
                 "lower": {**body, "element_size": 0.08e-3}},
        "materials": {"default": {**STIFF, "poisson_ratio": 0.0}}, "boundaries": [], "duration": 1e-6,
    })  # fmt: skip
    given = parse_case(table)
    model = Model(given)
    motion, state, face = given.stepper.bind(model), model.initial_state(), model.faults[0].interface
    advance(motion, state, 2 * motion.dt)  # far apart, at rest
    assert not np.any(state.velocity)
    upper = np.unique(model.space.dofmap.list[model.bodies.cell_body == 0])
    state.displacement.reshape(-1, 2)[upper, 1] = -1.49e-3
    state.velocity.reshape(-1, 2)[upper, 1] = -20.0
    assert not face.covered.any()
    forces: list[float] = []
    advance(motion, state, 0.8e-6, lambda state: forces.append(face.weight @ state.faults["main"]["normal_stress"]))
    assert face.covered.all()
    wave = np.sqrt(5.3e9 * 1246.0) * 10.0  # nu = 0: c_p = sqrt(E / rho)
    # The distance of 10 um is covered after 0.5 us; then the pressure is that of the wave, but for the ringing.
    np.testing.assert_allclose(np.mean(forces[-len(forces) // 5 :]) / 0.4e-3, wave, rtol=0.1)


def test_stable_step_of_springs_that_meet_later() -> None:
    """It counts them before they face anything: as small as where they touch, for equal bodies."""
    body = {"length": 0.4e-3, "height": 0.4e-3, "element_size": 0.1e-3}
    found = []
    for apart in (0.0, 1.5e-3):
        model = Model(parse_case(rough({
            "mesh": {"kind": "rough_plates", "curve_order": 1, "closest": apart, "upper": body, "lower": body},
            "materials": {"default": STIFF}, "boundaries": [], "faults.main.contact.C_n": 1e16,
            "faults.main.contact.C_s": 1e16, "faults.main.contact.kind": "compliant",
        })))  # fmt: skip
        assert model.faults[0].interface.covered.all() == (apart == 0)
        found.append(stable_time_step(model))
    np.testing.assert_allclose(found[1], found[0], rtol=0.02)
    assert found[1] < 0.5 * stable_time_step(model, [])


def test_sides_that_swap() -> None:
    """Which side carries the points changes little: the mean force between the bodies, the work of friction."""
    found = []
    for turned in (False, True):
        given = parse_case(rough({"duration": 8e-6, "damping.mass": 2e5}))
        raw = given.mesh.build()
        raw.interfaces["main"] = raw.interfaces["main"][::-1] if turned else raw.interfaces["main"]
        object.__setattr__(given.mesh, "build", lambda raw=raw: raw)
        found.append(mean_force_and_friction(given))
    np.testing.assert_allclose(found[1], found[0], rtol=0.03)


def mean_force_and_friction(given: Case) -> tuple[float, float]:
    """Mean normal force [N/m] and what friction took [J/m]."""
    model, forces = Model(given), []
    motion, state = given.stepper.bind(model), model.initial_state()
    weight, fault = model.faults[0].interface.weight, state.faults["main"]
    advance(motion, state, given.duration, lambda _: forces.append(weight @ fault["normal_stress"]))
    return float(np.mean(forces)), float(state.energy["frictional_dissipation"])


def test_split_nodes_that_slide_are_forward_lagrange() -> None:
    """Rigid contact by whatever name, bitwise."""
    given = [parse_case(rough({"faults.main.contact": contact})) for contact in (SPLIT, {"kind": "forward_lagrange"})]
    one, other = (march(each)[2] for each in given)
    assert one.faults["main"]["normal_stress"].max() > 1e6
    np.testing.assert_array_equal(one.displacement, other.displacement)


# -- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"faults.main.contact": CONTACTS["compliant"], "stepper": {"kind": "petsc_ts"}},
         r"faults.main.sliding: not for stepper.kind = 'petsc_ts'; use stepper.kind = .*'generalized_alpha'"),
        ({"faults.main.sliding": None}, r"'main' have meshes of their own; add the table \[faults.main.sliding\]"),
        ({"faults.main.gap": 1e-6}, r"faults.main.gap = 1e-06: surfaces that slide have the distance"),
        ({"plane": "antiplane", "boundaries": []}, r"faults.main.sliding: sliding far is for plane stress"),
        ({"boundaries": [{"kind": "periodic", "first": "upper.left", "second": "upper.right"}]},
         r"faults.main.sliding: the interface ends at periodic edges"),
        ({"mesh.upper.left": 3e-3}, r"mesh.upper.left = 0.003: the plates are beside each other"),
        ({"mesh.upper.profile": wave(1, 2e-3)}, r"cells are folded, the first near .* reduce the heights"),
    ],
)  # fmt: skip
def test_cases_that_cannot_slide(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        given = parse_case(rough(changes))
        given.stepper.bind(Model(given))


def test_bodies_that_overlap() -> None:
    given = parse_case(rough())
    raw = given.mesh.build()
    raw.points[np.unique(raw.cells[raw.cell_body == 0]), 1] -= 1e-6
    object.__setattr__(given.mesh, "build", lambda: raw)
    # The crests at x = 0, 0.6 and 1.2 mm touch; then they are 1 um in one another.
    with pytest.raises(RuptfxError, match=r"'main': the bodies overlap by (9|1\.0)\S*e-0[67] m at .* before anything"):
        Model(given)


@pytest.mark.parametrize(
    "mesh, other", [({"kind": "block_on_rigid"}, "rigid"), ({"kind": "half_plate"}, "antisymmetric"),
                    ({"kind": "half_plate", "symmetry": "symmetric"}, "symmetric")],
)  # fmt: skip
def test_one_side_without_a_body(mesh: dict[str, Any], other: str) -> None:
    size = {"length": 4e-3, "height": 1e-3, "element_size": 1e-3}
    table = plates({"mesh": {**mesh, **size}, "faults.main.sliding": {}})
    with pytest.raises(RuptfxError, match=facts(rf"faults.main.sliding: the minus side is not meshed \({other}\)")):
        Model(parse_case(table))


def test_forces_of_nothing_that_slides() -> None:
    with pytest.raises(
        RuptfxError, match=facts(r"output.forces_interval = 1e-06 s: forces are recorded where an interface")
    ):
        parse_case(plates({"output.forces_interval": 1e-6}))


@pytest.mark.parametrize("spacing, gaps, turn, expected", [
    (0.0, (1e-9, 0.0, -3e-9), 0.0, 0.75),  # an open point overlaps by 3 nm, where 4 nm are the largest pressure
    (1.0, (1e-9, 0.0, -3e-9), 0.0, 0.6),  # and 1 nm of rounding
    (0.0, (1e-9, 0.0, 3e-9), 0.0, 0.25),  # an open point that opens further counts nothing
    (0.0, (0.0, -2e-9, 0.0), 0.0, 0.5),  # or that is pressed together
    (0.0, (0.0, -2e-9, 0.0), 0.6, 0.6),  # a normal that turns by 0.6 under 4 MPa
])  # fmt: skip
def test_the_change_of_a_geometry(spacing: float, gaps: tuple[float, ...], turn: float, expected: float) -> None:
    """Points under 4, 1 and 0 MPa on bodies of 1e15 Pa/m."""
    frame = np.tile(np.eye(2), (3, 1, 1))
    jumps = [np.zeros((3, 2))]
    face = SimpleNamespace(
        frame=frame,
        plus=np.arange(3),
        jump=lambda displacement: jumps[-1],
        geometry=SimpleNamespace(plus=SimpleNamespace(spacing=np.full(3, spacing))),
    )

    def at(displacement: np.ndarray) -> None:
        jumps.append(np.stack([gaps, np.zeros(3)], axis=1))
        frame[0, 0] += (0.0, turn)

    follower: Any = SimpleNamespace(face=face, at=at, _pull_of=lambda fields: None, _estimate=None)
    fields = {"normal_stress": np.array([4e6, 1e6, 0.0])}
    change = StepFollower.change(follower, np.zeros(6), fields, np.full(3, 1e15), 4e6)
    assert change == pytest.approx(expected, rel=1e-12)
