"""Initial stress in its three forms and every way to start a rupture: exact values, closed energy budget."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.small_cases import SPLIT, case

pytest.importorskip("dolfinx")

from ruptfx.bodies.state import State
from ruptfx.case import Case
from ruptfx.input.schema import CaseError
from ruptfx.results.analysis import rupture_origin
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

WEAKENING = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 2e-7}
STIFF = {"kind": "compliant", "C_n": 300e12, "C_s": 10e12}
NUCLEATIONS = {
    "overstress": {"extra": {"kind": "boxcar", "inside": 2.4e6, "outside": 0.0, "center": 6e-3, "half_width": 1e-3}},
    "smooth_patch": {"extra": 3e6, "center": 6e-3, "radius": 2e-3, "rise": 1e-6},
    "forced_rupture": {"center": 6e-3, "radius": 2e-3, "speed": 1000.0, "mu_d": 0.1, "t_w": 5e-7},
    "friction_drop": {"center": 6e-3, "half_width": 1e-3, "mu_d": 0.0, "time": 5e-7},
    "normal_stress_drop": {"center": 6e-3, "half_width": 1e-3, "drop": 5e6, "duration": 2e-6, "rise": 1e-7},
}


def run(parsed: Case) -> tuple[Model, State, float]:
    model = Model(parsed)
    motion = parsed.stepper.bind(model)
    state = model.initial_state()
    while state.time < parsed.duration:
        motion.step(state)
    return model, state, motion.dt


def loaded(contact: dict, nucleation: dict | list) -> Case:
    return case({
        "faults.main.friction": WEAKENING, "faults.main.contact": contact,
        "faults.main.initial_stress": {"normal": 6e6, "shear": 2e6}, "faults.main.nucleation": nucleation,
    })  # fmt: skip


@pytest.mark.parametrize("contact", [SPLIT, STIFF], ids=lambda contact: contact["kind"])
@pytest.mark.parametrize("kind", NUCLEATIONS)
def test_nucleation_starts_a_rupture_and_its_work_is_accounted_for(kind: str, contact: dict) -> None:
    model, state, _ = run(loaded(contact, {"kind": kind, **NUCLEATIONS[kind]}))
    slip = np.abs(state.faults["main"]["slip"])
    position = model.faults[0].interface.position
    assert slip[np.argmin(np.abs(position - 6e-3))] > 1e-7
    energy = model.energies(state)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert abs(lost) < 1e-10 * abs(energy["frictional_dissipation"])


@pytest.mark.parametrize("center", [6e-3, {"x": 6e-3, "y": 0.0}], ids=["position", "point"])
@pytest.mark.parametrize(("kind", "key"), [
    ("normal_stress_drop", "begin"), ("friction_drop", "time"), ("forced_rupture", "start"),
])  # fmt: skip
def test_analysis_knows_where_and_when_a_case_starts_a_rupture(
    kind: str, key: str, center: object, tmp_path: Path
) -> None:
    """The origin of the rupture is where the nucleation is, when it begins."""
    begins = 4e-7
    given = loaded(SPLIT, {"kind": kind, **NUCLEATIONS[kind], "center": center, key: begins})
    with simulate(given, out=tmp_path / "run", progress=False) as record:
        # The element is 1 mm long and has a node at 6 mm.
        assert rupture_origin(record) == (pytest.approx(6e-3, rel=1e-12), begins)


def test_nothing_moves_without_nucleation() -> None:
    _, state, _ = run(loaded(SPLIT, []))
    # 1e-16 of the 6 MPa over the impedance of some 1e6 Pa s/m.
    assert np.abs(state.velocity).max() < 1e-12


def test_tensor_is_resolved_on_the_interface() -> None:
    # n = +y, t = +x: normal stress 6 MPa, shear 2 MPa; xx does not matter.
    by_tensor = case({"faults.main.initial_stress": {"tensor": [-3e6, -6e6, 2e6]}})
    fault = Model(by_tensor).faults[0]
    np.testing.assert_allclose(fault.normal_stress_0, 6e6, rtol=1e-14)
    np.testing.assert_allclose(fault.shear_traction_0, 2e6, rtol=1e-14)
    with pytest.raises(CaseError, match=r"initial_stress.*\btensor\b"):
        case({"faults.main.initial_stress": {"tensor": [-3e6, -6e6, 2e6], "normal": 6e6}})


def test_table_from_a_csv_file(tmp_path: Path) -> None:
    file = tmp_path / "shear.csv"
    file.write_text("position,shear\n0.0,1e6\n0.012,3e6\n")
    table = {"normal": 6e6, "shear": {"kind": "table", "file": str(file)}}
    fault = Model(case({"faults.main.initial_stress": table})).faults[0]
    np.testing.assert_allclose(fault.shear_traction_0[:, 0], 1e6 + 2e6 / 0.012 * fault.interface.position, rtol=1e-12)


def test_table_shorter_than_the_interface_is_refused_before_the_first_step() -> None:
    short = {"kind": "table", "positions": [0.0, 0.01], "values": [1e6, 2e6]}
    covers = r"faults.main.{}: .* 0 to 0.01 m .* to 0.012 m"
    with pytest.raises(CaseError, match=covers.format("initial_stress.shear")):
        Model(case({"faults.main.initial_stress": {"normal": 6e6, "shear": short}}))
    with pytest.raises(CaseError, match=covers.format("nucleation.0.extra")):
        Model(case({"faults.main.nucleation": [{"kind": "overstress", "extra": short}]}))


def test_slip_rate_and_state_give_the_stress() -> None:
    law = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6}
    given = {**law, "V_initial": 1e-9, "theta_initial": 1e4}
    fault = Model(case({"faults.main.friction": given, "faults.main.initial_stress": {"normal": 6e6}})).faults[0]
    # theta = D_c / V: steady, f = f_0 + (a - b) ln(V / V_0) = 0.6 + 0.005 ln(1000).
    np.testing.assert_allclose(fault.shear_traction_0, 6e6 * (0.6 + 0.005 * np.log(1000)), rtol=1e-12)
    np.testing.assert_allclose(fault.initial_state()["slip_rate"], 1e-9, rtol=1e-10)
    contradictory = {"faults.main.friction": given, "faults.main.initial_stress": {"normal": 6e6, "shear": 1e6}}
    with pytest.raises(CaseError, match=r"initial_stress\.shear: friction\.V_initial"):
        Model(case(contradictory))
