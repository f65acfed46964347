"""Edges that hold one direction where they meet an inclined fault: no jump of points that stick, and closed budgets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, SPLIT, case, march

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import gradient
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.mechanisms.sliding import SlidingFaults

pytestmark = pytest.mark.fem

SECTION = {"kind": "inclined_plates", "side": 12e-3, "inclination": 0.35, "element_size": 3e-3}
SOLID = {"kind": "extruded", "section": SECTION, "thickness": 6e-3, "layers": 2}
WEAKENING = {"kind": "linear_slip_weakening", "mu_s": 0.5, "mu_d": 0.2, "D_c": 2e-6}
FRICTIONS = {"stuck": {"kind": "coulomb", "mu_d": 50.0}, "sliding": WEAKENING,
             "creeping": {"kind": "rate_and_state_ageing", "a": 0.012, "b": 0.02, "D_c": 1e-6, "f_0": 0.4, "V_0": 1e-3,
                          "V_initial": 1e-3}}  # fmt: skip
LAGRANGE = {"kind": "forward_lagrange"}


def driven(edge: str, component: str, velocity: float = 0.0, ramp: float = 2e-6) -> dict[str, Any]:
    return {"kind": "driven", "edge": edge, "component": component, "velocity": velocity, "ramp": ramp}


HELD = {
    "driven": [driven("upper.left", "x", 5.0)],
    "both sides": [driven("upper.left", "x"), driven("lower.left", "x"), driven("upper.right", "x", -5.0)],
    "along x and y": [driven("upper.left", "x", 5.0), driven("upper.left", "y")],
    "absorbing": [{"kind": "absorbing", "edge": "upper.left"}, {"kind": "absorbing", "edge": "lower.left"},
                  driven("upper.top", "x", 5.0)],
}  # fmt: skip


def plates(friction: str, boundaries: str, contact: dict[str, Any] = SPLIT, shear: float = 2.8e6,
           **changes: Any) -> Any:  # fmt: skip
    """Plates along a line inclined by 20 degrees, pressed by 6 MPa."""
    return case({
        "mesh": SECTION, "order": 2, "duration": 6e-6, "faults.main.contact": contact,
        "faults.main.friction": FRICTIONS[friction], "boundaries": HELD[boundaries],
        "faults.main.initial_stress": {"normal": 6e6, "shear": shear}, **changes,
    })  # fmt: skip


def closure(model: Any, motion: Any, state: Any) -> float:
    """Unaccounted energy over the work of the boundaries."""
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    return abs(work - sum(energy.values())) / abs(work)


def jump_beyond_slip(model: Any, state: Any) -> float:
    """Largest tangential displacement jump beyond the slip at one time [m], of closed points."""
    fault, fields = model.faults[0], state.faults["main"]
    _, jump = fault.interface.split(fault.interface.jump(state.displacement - state.lag * state.velocity))
    return float(np.abs((jump - fault.components(fields, "slip"))[fields["normal_stress"] > 0]).max())


@pytest.mark.parametrize("contact", [SPLIT, LAGRANGE], ids=["split_node", "forward_lagrange"])
@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("boundaries", HELD)
def test_budgets_close_and_jumps_are_slip(boundaries: str, friction: str, contact: dict[str, Any]) -> None:
    """In explicit steps of rigid contact; the displacements of points that stick stay equal to rounding."""
    model, motion, state = march(plates(friction, boundaries, contact))
    assert len(model.faults[0].interface.plus)
    assert closure(model, motion, state) < 1e-12
    assert jump_beyond_slip(model, state) < 1e-15
    slip = state.faults["main"]["slip"]
    assert np.abs(slip).max() > 1e-8 if friction != "stuck" else not slip.any()


@pytest.mark.parametrize("friction", ["stuck", "sliding"])
@pytest.mark.parametrize("boundaries", ["driven", "both sides"])
def test_solid_bodies(boundaries: str, friction: str) -> None:
    """The same section, two layers thick."""
    model, motion, state = march(plates(friction, boundaries, mesh=SOLID, plane="solid", duration=3e-6))
    assert closure(model, motion, state) < 1e-12
    assert jump_beyond_slip(model, state) < 1e-15


@pytest.mark.parametrize("boundaries", ["driven", "both sides"])
def test_sweeps_of_finite_sliding_converge(boundaries: str) -> None:
    """To 1e-6 of the tractions in every step, within the largest number of sweeps."""
    model, motion, state = march(plates("stuck", boundaries, LAGRANGE, **{"faults.main.sliding": {}}))
    assert closure(model, motion, state) < 1e-12
    assert jump_beyond_slip(model, state) < 1e-10  # 1e-6 of 40 MPa over 1 MPa s/m, in 6 us: 2e-10
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    assert not any(step.unconverged for steps in sliding.steps for step in steps)


@pytest.mark.parametrize("friction", ["stuck", "sliding"])
def test_compliant_contact(friction: str) -> None:
    model, motion, state = march(plates(friction, "driven", COMPLIANT))
    assert closure(model, motion, state) < 1e-12


@pytest.mark.parametrize("friction", ["stuck", "sliding"])
def test_explicit_steps_are_implicit_ones(friction: str) -> None:
    """Slip and tractions at the end of the fault on the driven edge at 6 us; explicit ones are a step behind."""
    ends = []
    for stepper, step in (("leapfrog", 1e-8), ("generalized_alpha", 2e-8)):
        given = plates(friction, "driven", stepper={"kind": stepper, "time_step": step})
        model, _, state = march(given, 6e-6 + (step if stepper == "leapfrog" else 0.0))
        assert state.fault_time == pytest.approx(6e-6, rel=1e-9)
        first = np.argmin(model.faults[0].interface.points[:, 0])
        ends.append([state.faults["main"][name][first] for name in ("slip", "normal_stress", "shear_traction")])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-3)


def test_a_point_that_both_sides_hold_cannot_slip() -> None:
    """Its jump is along y alone, which would open or close it; the others slide."""
    model, _, state = march(plates("sliding", "both sides"))
    fields, x = state.faults["main"], model.faults[0].interface.points[:, 0]
    assert fields["slip"][np.argmin(x)] == pytest.approx(0.0, abs=1e-15)
    assert np.abs(fields["slip"]).max() > 1e-8


def test_gradients_are_refused_there() -> None:
    """Compliant contact and an edge that is held along x and y have one; the message names the point."""
    term = {"objective": [{"kind": "final_slip", "target": 1e-6, "sigma": 1e-6}], "duration": 1e-6}
    unknowns = ["faults.main.initial_stress.shear"]
    # The left end of the fault: half of the side less half of its rise.
    y = 6e-3 * (1 - np.tan(0.35))
    with pytest.raises(CaseError, match=facts(rf"faults\.main\.contact.*\(0, {y:.6g}\) m.*compliant")):
        gradient(plates("sliding", "driven", shear=3.5e6, **term), unknowns=unknowns, progress=False)
    for boundaries, contact in (("driven", COMPLIANT), ("along x and y", SPLIT)):
        given = plates("sliding", boundaries, contact, shear=3.5e6, **term)
        made = gradient(given, unknowns=unknowns, progress=False)
        assert np.isfinite(made[unknowns[0]]).all()
