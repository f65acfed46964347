"""Interfaces that cohesion holds: what they carry, what breaking them takes, and the budget of energy meanwhile."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from small_cases import COMPLIANT, HOMALITE, SPLIT, case, march

pytest.importorskip("dolfinx")

from ruptfx.check_law.examples import table
from ruptfx.fields import ENERGIES
from ruptfx.model import Model
from ruptfx.preflight import preflight
from ruptfx.schema import CaseError, alternatives

pytestmark = pytest.mark.fem

# Homalite with a strength of 4 MPa fails over some micrometres: l_ch = E G / f_t^2 = 10 mm.
BOND = {"kind": "linear", "f_t": 4e6, "c": 8e6, "G_Ic": 30.0, "G_IIc": 60.0}
RUBS = {"kind": "coulomb", "mu_d": 0.4}
RIGID = [kind for kind, cls in alternatives("ruptfx.contact").items() if cls.explicit and not cls.traction_ends_slip]


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


@pytest.mark.parametrize("contact", RIGID)
@pytest.mark.parametrize("kind", alternatives("ruptfx.cohesion"))
@pytest.mark.parametrize("mode", ["I", "II"])
def test_breaking_takes_the_fracture_energy_and_nothing_is_lost(contact: str, kind: str, mode: str) -> None:
    """Of one mode over the whole interface: trapezoids in time."""
    law = table(alternatives("ruptfx.cohesion")[kind]) | BOND | {"kind": kind}
    given = bonded({"kind": contact}, **{
        "boundaries": moved("y" if mode == "I" else "x", 1.0), "faults.main.cohesion": law,
        "stepper.safety": 0.5, "duration": 60e-6,
    })  # fmt: skip
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration:
        state.watched = state.step % 2 == 0
        motion.step(state)
        energy = motion.energies(state)
        lost = energy["boundary_work"] - sum(energy[name] for name in ENERGIES if name != "boundary_work")
        assert abs(lost) <= 1e-11 * max(abs(energy["boundary_work"]), 1e-6)
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


@pytest.mark.parametrize(("changes", "said"), [
    ({"faults.main.gap": 1e-6}, "faults.main.gap has no cohesion"),
    ({"faults.main.contact": COMPLIANT}, "not with contact.kind = 'compliant'"),
    ({"faults.main.cohesion": {**BOND, "f_t": -1.0}}, r"cohesion.f_t = -1.0"),
])  # fmt: skip
def test_what_cannot_be_bonded_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=said):
        given = bonded(SPLIT, **changes)
        given.stepper.bind(Model(given))


def test_check_tells_the_zones_and_what_breaks_at_once() -> None:
    """9 pi / 16 G* G / strength^2, with G* = G (1 + nu) in plane stress."""
    given = bonded(SPLIT, **{"faults.main.initial_stress": {"tensor": [0.0, 6e6, 0.0]}})
    rows = {row.quantity: row for row in preflight(given)}
    modulus = HOMALITE["young_modulus"] / 2
    for mode, strength, energy in (("I", 4e6, 30.0), ("II", 8e6, 60.0)):
        found = rows[f"faults.main: bond, process zone {mode}"].value
        assert found == pytest.approx(9 * np.pi / 16 * modulus * energy / strength**2, rel=1e-3)
    assert rows["faults.main: tension / strength"].value == pytest.approx(1.5)
    assert rows["faults.main: tension / strength"].verdict == "warning"
    assert rows["faults.main: strength at rest"].value == 8e6
