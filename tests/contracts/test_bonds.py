"""Interfaces that cohesion holds: what they carry, what breaking them takes, and the budget of energy meanwhile."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import rough
from helpers.small_cases import COMPLIANT, HOMALITE, SPLIT, case, march, springs

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.app.check_law.examples import table
from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case
from ruptfx.input.fields import ENERGIES
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

# Homalite with a strength of 4 MPa fails over some micrometres: l_ch = E G / f_t^2 = 10 mm.
BOND = {"kind": "linear", "f_t": 4e6, "c": 8e6, "G_Ic": 30.0, "G_IIc": 60.0}
RUBS = {"kind": "coulomb", "mu_d": 0.4}
STIFF = springs("compliant", 5e12)  # much stiffer than bodies and softening
METHODS = {kind: cls for kind, cls in alternatives("ruptfx.laws.contact").items() if cls.explicit}
every_method = pytest.mark.parametrize("contact", [springs(kind, 5e12) for kind in METHODS], ids=METHODS)
every_implicit_method = pytest.mark.parametrize("contact", [
    pytest.param(springs(kind, 5e12), id=kind) for kind, cls in METHODS.items()
    if cls.implicit or "methods for other steps" in cls.offers
])  # fmt: skip
CONSERVING = {"kind": "generalized_alpha", "scheme": "average_acceleration"}


def bonded(contact: dict[str, Any], **changes: Any) -> Any:
    """Two plates that nothing but a bond holds together."""
    return case({
        "faults.main": {"contact": contact, "friction": RUBS, "cohesion": BOND, "initial_stress": {"normal": 0.0}},
        "mesh": {"kind": "two_plates", "length": 4e-3, "height": 4e-3, "element_size": 2e-3}, "duration": 40e-6,
        **changes,
    })  # fmt: skip


def moved(component: str, velocity: float) -> list[dict[str, Any]]:
    """Ends that move apart, or along each other; all columns of elements do the same."""
    other = "xy".replace(component, "")
    ends = [("upper.top", velocity), ("lower.bottom", -velocity)]
    sides = ["upper.left", "upper.right", "lower.left", "lower.right"]
    table = [{"kind": "driven", "edge": edge, "component": component, "velocity": v, "ramp": 5e-6} for edge, v in ends]
    return table + [{"kind": "driven", "edge": edge, "component": other, "velocity": 0.0} for edge in sides]


def lost(energy: dict[str, float]) -> float:
    """Energy that the budget does not account for [J]."""
    return energy["boundary_work"] - sum(energy[name] for name in ENERGIES if name != "boundary_work")


@every_method
@pytest.mark.parametrize("kind", alternatives("ruptfx.laws.cohesion"))
@pytest.mark.parametrize("mode", ["I", "II"])
def test_breaking_takes_the_fracture_energy_and_nothing_is_lost(contact: dict[str, Any], kind: str, mode: str) -> None:
    """Of one mode over the whole interface: trapezoids in time."""
    law = table(alternatives("ruptfx.laws.cohesion")[kind]) | BOND | {"kind": kind}
    given = bonded(contact, **{
        "boundaries": moved("y" if mode == "I" else "x", 1.0), "faults.main.cohesion": law,
        "stepper.safety": 0.5, "duration": 60e-6,
    })  # fmt: skip
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration and not np.all(state.faults["main"]["damage"] == 1):
        state.wants_energies = state.step % 2 == 0
        motion.step(state)
        energy = motion.energies(state)
        assert abs(lost(energy)) <= 1e-11 * max(abs(energy["boundary_work"]), 1e-6)
    fields, area = state.faults["main"], 4e-3
    assert np.all(fields["damage"] == 1)
    broken = law["G_Ic"] if mode == "I" else law["G_IIc"]
    assert state.energy["fracture"] / area == pytest.approx(broken, rel=2e-3)
    assert abs(state.energy["frictional_dissipation"]) < 1e-6 * area * broken
    assert np.all(fields["normal_stress"] >= 0)


def test_the_strength_is_that_of_the_law() -> None:
    """Tension up to f_t; in shear under pressure c and friction besides."""
    for component, initial, expected in (("y", {"normal": 0.0}, 4e6), ("x", {"normal": 5e6}, 8e6 + 0.4 * 5e6)):
        given = bonded(SPLIT, **{"boundaries": moved(component, 1.0), "faults.main.initial_stress": initial})
        name = "normal_stress" if component == "y" else "shear_traction"
        largest = 0.0

        def look(state: Any) -> None:
            nonlocal largest
            largest = max(largest, float(np.abs(state.faults["main"][name]).max()))  # noqa: B023

        model = Model(given)
        motion, state = given.stepper.bind(model), model.initial_state()
        while state.time < given.duration:
            motion.step(state)
            look(state)
        assert largest == pytest.approx(expected, rel=1e-9)
        assert np.all(state.faults["main"]["damage"] == 1)


def test_what_has_failed_rubs() -> None:
    given = bonded(SPLIT, **{
        "boundaries": moved("x", 1.0), "faults.main.initial_stress": {"normal": 5e6}, "duration": 80e-6,
    })  # fmt: skip
    _, _, state = march(given)
    fields = state.faults["main"]
    assert np.all(fields["damage"] == 1)
    np.testing.assert_allclose(fields["shear_traction"], 0.4 * fields["normal_stress"], rtol=1e-9)
    assert state.energy["fracture"] / 4e-3 == pytest.approx(60.0, rel=5e-3)
    assert state.energy["frictional_dissipation"] > 0


def test_a_crack_from_the_start_carries_nothing() -> None:
    """Where the strength is zero; the rest holds the initial tension."""
    crack = {"kind": "boxcar", "inside": 0.0, "outside": 4e6, "center": 0.0, "half_width": 1.2e-3}
    given = bonded(SPLIT, **{
        "faults.main.initial_stress": {"tensor": [0.0, 1e6, 0.0]}, "duration": 1e-6,
        "faults.main.cohesion": {**BOND, "f_t": crack, "c": {**crack, "outside": 8e6}},
    })  # fmt: skip
    model, _, state = march(given)
    fields, x = state.faults["main"], model.faults[0].interface.position
    inside = x < 1.2e-3
    assert inside.any() and np.all(fields["normal_stress"][inside] == 0) and np.all(fields["opening"][inside] > 0)
    assert np.all(fields["normal_stress"][~inside] < -0.5e6) and np.all(np.abs(fields["opening"][~inside]) < 1e-15)


@every_implicit_method
@pytest.mark.parametrize("mode", ["I", "II"])
@pytest.mark.parametrize("stepper", [CONSERVING, {"kind": "quasi_static"}], ids=lambda stepper: stepper["kind"])
def test_implicit_steps_break_with_the_same_energy(contact: dict[str, Any], stepper: dict[str, Any], mode: str) -> None:
    """Damage, opening and slip are solved for in the step: G times the area, traction up to the strength, budget.

    The bodies are stiffer than the softening, f^2 / (2 G) in Pa/m, so that there is an equilibrium all the way.
    """
    longest = {"largest_step": 0.3e-6} if stepper["kind"] == "quasi_static" else {"courant": 2.0}
    given = bonded(contact, **{
        "boundaries": moved("y" if mode == "I" else "x", 1.0), "faults.main.cohesion": {**BOND, "G_IIc": 200.0},
        "stepper": {**stepper, **longest}, "duration": 60e-6 if mode == "I" else 100e-6,
    })  # fmt: skip
    model = Model(given)
    motion, state, largest = given.stepper.bind(model), model.initial_state(), 0.0
    while state.time < given.duration * (1 - 1e-9) and not np.all(state.faults["main"]["damage"] == 1):
        motion.step(state)
        energy = motion.energies(state)
        assert abs(lost(energy)) <= 1e-10 * max(abs(energy["boundary_work"]), 1e-6)
        name = "normal_stress" if mode == "I" else "shear_traction"
        largest = max(largest, float(np.abs(state.faults["main"][name]).max()))
    strength, broken = (4e6, 30.0) if mode == "I" else (8e6, 200.0)
    assert np.all(state.faults["main"]["damage"] == 1)
    assert state.energy["fracture"] / 4e-3 == pytest.approx(broken, rel=2e-3)
    assert 0.93 * strength < largest < (1 + 1e-9) * strength
    assert abs(state.energy["frictional_dissipation"]) < 1e-6 * 4e-3 * broken


@pytest.mark.parametrize("contact", [SPLIT, STIFF], ids=lambda contact: contact["kind"])
def test_explicit_and_implicit_steps_agree(contact: dict[str, Any]) -> None:
    """Cracks that grow from both sides, in steps as short as explicit ones: 0.012 in damage, 4.5 % in traction found.

    The implicit scheme damps what its steps do not resolve: with rigid contact, average acceleration chatters.
    """
    fields = []
    corner = {"kind": "driven", "edge": "upper.left", "velocity": 2.0, "ramp": 5e-6}
    damped = {"kind": "generalized_alpha", "spectral_radius": 0.0, "courant": 0.5}
    for stepper in ({"kind": "leapfrog", "safety": 0.5}, damped):
        given = bonded(contact, order=2, duration=15e-6, stepper=stepper, **{
            "boundaries": [{**corner, "component": component} for component in "xy"], "mesh.element_size": 1e-3,
        })  # fmt: skip
        _, _, state = march(given)
        fields.append(state.faults["main"])
    explicit, implicit = fields
    damage = explicit["damage"]
    assert np.any(damage > 0.5) and np.any((damage > 0.1) & (damage < 0.4)) and np.any(damage < 0.01)
    np.testing.assert_allclose(implicit["damage"], damage, rtol=0, atol=0.02)
    np.testing.assert_allclose(implicit["shear_traction"], explicit["shear_traction"], rtol=0, atol=0.06 * 8e6)


@pytest.mark.parametrize("contact", [
    pytest.param(SPLIT, id="split_node", marks=pytest.mark.slow), pytest.param(STIFF, id="compliant"),
])  # fmt: skip
def test_slow_loading_ends_in_a_fast_rupture(contact: dict[str, Any]) -> None:
    """Softening f_t^2 / (2 G) above the stiffness of the bodies: no equilibrium beyond the strength, which `hybrid`
    finds out, breaks in explicit steps and comes to rest; G times the area, the rest of the stored energy is damped."""
    slowly = [{**b, "velocity": 1e-3 * b["velocity"]} | ({"ramp": 5e-3} if "ramp" in b else {})
              for b in moved("y", 1.0)]  # fmt: skip
    changes = {
        "boundaries": slowly, "faults.main.cohesion": {**BOND, "G_Ic": 6.0}, "duration": 8e-3, "damping": {"mass": 2e5},
        "mesh": {"kind": "two_plates", "length": 2e-3, "height": 4e-3, "element_size": 2e-3},
    }  # fmt: skip
    given = bonded(contact, **changes, stepper={"kind": "hybrid", "calm_for": 20e-6})
    model = Model(given)
    motion, state, largest, fast = given.stepper.bind(model), model.initial_state(), 0.0, []
    while state.time < given.duration * (1 - 1e-9):
        motion.step(state)
        fields = state.faults["main"]
        largest = max(largest, float(-fields["normal_stress"].min()))
        if not fast or fast[-1] != state.numbers["fast"]:
            fast.append(state.numbers["fast"])
    energy = motion.energies(state)
    assert fast == [0, 1, 0]
    assert np.all(fields["damage"] == 1) and largest == pytest.approx(4e6, rel=0.05)
    assert state.energy["fracture"] / 2e-3 == pytest.approx(6.0, rel=5e-3)
    assert abs(lost(energy)) <= 1e-10 * energy["boundary_work"]
    assert energy["damping"] > 0.3 * energy["boundary_work"]  # stored beyond what breaking takes


@pytest.mark.parametrize("contact", [{"kind": "forward_lagrange"}, STIFF], ids=lambda contact: contact["kind"])
@pytest.mark.parametrize("stepper", [{"kind": "leapfrog", "safety": 0.5}, {"kind": "quasi_static"}],
                         ids=lambda stepper: stepper["kind"])  # fmt: skip
def test_surfaces_whose_nodes_do_not_match_are_sheared_off(contact: dict[str, Any], stepper: dict[str, Any]) -> None:
    """Slip of a fifth of an element, over several updates of the pairing: G times the area, budget."""
    given = bonded(contact, order=2, duration=100e-6, stepper=stepper, boundaries=moved("x", 1.0), **{
        "faults.main.sliding": {}, "faults.main.cohesion": {**BOND, "G_IIc": 200.0},
        "mesh": {"kind": "rough_plates", "upper": {"length": 4e-3, "height": 2e-3, "element_size": 1e-3},
                 "lower": {"left": -1e-3, "length": 6e-3, "height": 2e-3, "element_size": 0.73e-3}},
    })  # fmt: skip
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration * (1 - 1e-9):
        motion.step(state)
        energy = motion.energies(state)
        assert abs(lost(energy)) <= 1e-11 * max(abs(energy["boundary_work"]), 1e-6)
    fields = state.faults["main"]
    assert np.all(fields["damage"] == 1) and np.all(np.abs(fields["slip"]) > 150e-6)
    assert state.energy["fracture"] / 4e-3 == pytest.approx(200.0, rel=2e-3)
    assert abs(energy["impact_loss"]) + abs(energy["pairing_update_loss"]) < 1e-3 * energy["boundary_work"]


def test_surfaces_that_do_not_touch_are_not_held() -> None:
    """Opposed waves: nothing but their crests is held together; what slides off its opposite surface is let go."""
    given = parse_case(rough({"faults.main.cohesion": BOND, "mesh.lower.left": 0.15e-3}))
    model = Model(given)
    fields, face = model.initial_state().faults["main"], model.faults[0].interface
    np.testing.assert_array_equal(fields["damage"] == 0, face.covered & (fields["opening"] < 1e-9))
    assert 0 < np.sum(fields["damage"] == 0) < 0.2 * len(face.covered)


@pytest.mark.parametrize(("changes", "said"), [
    ({"faults.main.gap": 1e-6}, "faults.main.gap has no cohesion"),
    ({"faults.main.contact": COMPLIANT, "stepper": {"kind": "quasi_dynamic"}},
     "not for stepper.kind = 'quasi_dynamic'"),
    ({"faults.main.cohesion": {**BOND, "f_t": -1.0}}, r"cohesion.f_t = -1.0"),
])  # fmt: skip
def test_what_cannot_be_bonded_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=facts(said)):
        given = bonded(SPLIT, **changes)
        given.stepper.bind(Model(given))


def test_check_tells_the_zones_and_what_breaks_at_once() -> None:
    """9 pi / 16 G* G / strength^2, with G* = G (1 + nu) in plane stress."""
    given = bonded(SPLIT, **{"faults.main.initial_stress": {"tensor": [0.0, 6e6, 0.0]}})
    rows = {row.quantity: row for row in preflight(given)}
    modulus = HOMALITE["young_modulus"] / 2
    for mode, strength, energy in (("I", 4e6, 30.0), ("II", 8e6, 60.0)):
        found = rows[f"faults.main: cohesion, process zone {mode}"].value
        assert found == pytest.approx(9 * np.pi / 16 * modulus * energy / strength**2, rel=1e-3)
    assert rows["faults.main: tension / strength"].value == pytest.approx(1.5)
    assert rows["faults.main: tension / strength"].verdict == "warning"
    assert rows["faults.main: strength at rest"].value == 8e6
    assert "faults.main: springs / softening I" not in rows


def test_check_warns_of_springs_that_are_softer_than_the_softening() -> None:
    """Softening f_t^2 / (2 G_Ic) is 267 GPa/m, c^2 / (2 G_IIc) 533 GPa/m."""
    given = bonded({"kind": "compliant", "C_n": 300e9, "C_s": 300e9})
    rows = {row.quantity: row for row in preflight(given)}
    for mode, ratio, verdict in (("I", 1.125, "ok"), ("II", 0.5625, "warning")):
        row = rows[f"faults.main: springs / softening {mode}"]
        assert row.value == pytest.approx(ratio, rel=1e-9) and row.verdict == verdict
