"""Initial stress of the bodies: tractions of interfaces, prestress of yielding materials, equilibrium, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import Table
from ruptfx.app.checks.stress import stress_rows
from ruptfx.bodies.initial_stress import tractions
from ruptfx.bodies.initial_stress.depth import Depth
from ruptfx.bodies.initial_stress.uniform import Uniform
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, set_key
from ruptfx.interfaces.faults.initial_stress import InitialStress
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields

VERTICAL, PORES = 2700 * 9.8, 9800.0  # Pa per metre of depth, TPV12 and TPV13
EFFECTIVE = VERTICAL - PORES
ACROSS = (15624.3 - PORES) / EFFECTIVE
ALONG = (0.5 * (VERTICAL + 15624.3) - PORES) / EFFECTIVE
END = 11951.0  # depth below which the stress is isotropic
TPV12: Table = {
    "kind": "depth", "density": 2700.0, "fluid_density": 1000.0, "gravity": 9.8, "along": ALONG, "across": ACROSS,
    "isotropic": [END, END],
}  # fmt: skip
ELASTIC: Table = {"kind": "isotropic_elastic", "c_p": 5716.0, "c_s": 3300.0, "density": 2700.0}
YIELDING: Table = {
    **ELASTIC, "kind": "drucker_prager", "cohesion": 5e6, "friction_angle": float(np.arctan(0.85)),
    "relaxation_time": 0.03,
}  # fmt: skip
METAL: Table = {**ELASTIC, "kind": "von_mises", "yield_stress": 500e6, "relaxation_time": 0.03}
SIX = [-50e6, -120e6, -60e6, 70e6, 3e6, -8e6]
DAMAGED: Table = {
    **ELASTIC, "kind": "continuum_damage", "strength": 50e6, "softening_strain": 0.01, "relaxation_time": 0.03,
}  # fmt: skip
PRESSED = [-50e6, -50e6, -50e6, 0.0, 0.0, 0.0]
SECTION: Table = {"kind": "two_plates", "length": 8e-3, "height": 4e-3, "element_size": 2e-3}


SAND = """
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

class Sand(IsotropicElastic):
    def stress(self, strain, state, dt):
        return strain, state
"""


def table(changes: Table | None = None) -> Table:
    found: Table = {
        "plane": "solid", "order": 2, "duration": 0.5,
        "mesh": {
            "kind": "box_with_fault", "dip": 60.0, "fault_length": 6e3, "fault_width": 18e3, "element_size": 3e3,
            "beyond": 3e3, "distance": 6e3,
        },
        "materials": {"default": dict(ELASTIC)}, "initial_stress": dict(TPV12),
        "faults": {"main": {"contact": {"kind": "split_node"}, "friction": {
            "kind": "cohesion", "c": 0.2e6, "law": {"kind": "coulomb", "mu_d": 0.7}}}},
    }  # fmt: skip
    for key, value in (changes or {}).items():
        set_key(found, key, value)
    return found


def section(changes: Table) -> Table:
    found = table({"plane": "strain", "mesh": SECTION, "initial_stress": {"kind": "uniform", "tensor": SIX}})
    for key, value in changes.items():
        set_key(found, key, value)
    return found


def rows(case: Case) -> dict[str, Row]:
    return {row.quantity: row for row in stress_rows(Model(case))}


def depth(given: Table) -> Depth:
    return Depth.model_validate({key: value for key, value in given.items() if key != "kind"})


def test_tractions_on_planes_of_any_dip_and_strike() -> None:
    """Against the normal, strike and dip vectors of seismology, x east, y north, z up (Aki and Richards 2002)."""
    rng = np.random.default_rng(3)
    strike, dip = rng.uniform(0, 2 * np.pi, 200), rng.uniform(0.1, 0.5 * np.pi, 200)
    zero = 0 * strike
    along = np.stack([np.sin(strike), np.cos(strike), zero], axis=1)
    down = np.stack([np.cos(dip) * np.cos(strike), -np.cos(dip) * np.sin(strike), -np.sin(dip)], axis=1)
    normal = np.stack([np.sin(dip) * np.cos(strike), -np.sin(dip) * np.sin(strike), np.cos(dip)], axis=1)
    frame = np.stack([normal, along, down], axis=1)
    points = np.column_stack([zero, zero, rng.uniform(-1e4, 0, 200)])
    normal_stress, shear = tractions(depth(TPV12 | {"shear": 0.1}).effective(points), frame)
    P = -EFFECTIVE * points[:, 2]
    sine, cosine = np.sin(strike), np.cos(strike)
    # Horizontal stresses across and along strike, and the shear stress between them.
    facing = ALONG * cosine**2 + ACROSS * sine**2 + 0.2 * sine * cosine
    turned = (ACROSS - ALONG) * sine * cosine + 0.1 * (cosine**2 - sine**2)
    size = 1e-14 * P.max()
    assert normal_stress == pytest.approx(P * (facing * np.sin(dip) ** 2 + np.cos(dip) ** 2), abs=size)
    assert shear[:, 0] == pytest.approx(P * np.sin(dip) * turned, abs=size)
    assert shear[:, 1] == pytest.approx(P * np.sin(dip) * np.cos(dip) * (1 - facing), abs=size)


def test_tpv12_down_the_dip() -> None:
    """7390.01 Pa/m of normal stress, 0.549847 of it as shear stress, and no shear below 13.8 km [SCEC/USGS TPV12].

    The stresses of the benchmark have 6 digits.
    """
    fault = Model(parse_case(table())).faults[0]
    down = fault.interface.locations[:, 1]
    above = (down > 0) & (down < END / np.sin(np.pi / 3))
    below = down > END / np.sin(np.pi / 3)
    assert above.any() and below.any()
    assert fault.normal_stress_0[above] == pytest.approx(7390.01 * down[above], rel=1e-5)
    assert fault.shear_traction_0[above, 1] == pytest.approx(0.549847 * 7390.01 * down[above], rel=1e-5)
    assert np.abs(fault.shear_traction_0[:, 0]).max() < 1e-12 * fault.normal_stress_0.max()
    assert fault.normal_stress_0[below] == pytest.approx(14427.98 * down[below], rel=1e-6)
    assert np.abs(fault.shear_traction_0[below]).max() < 1e-12 * fault.normal_stress_0.max()
    assert fault.shear_direction[above] == pytest.approx(np.tile([0.0, 1.0], (above.sum(), 1)), abs=1e-12)


def test_nucleations_act_along_the_shear_traction_of_each_point() -> None:
    """Where it is rounding they act along strike, whatever the shear tractions of other points of the same rank are."""
    normal = np.array([0.0, 2e6, 1e7, 1e7])
    shear = np.array([[0.0, 0.0], [3e5, 4e5], [1e-9, -3e-9], [0.0, -1e6]])
    found = InitialStress().directions(normal, shear)
    assert found == pytest.approx(np.array([[1.0, 0.0], [0.6, 0.8], [1.0, 0.0], [0.0, -1.0]]), abs=1e-15)
    assert np.array_equal(InitialStress().directions(normal[2:3], shear[2:3]), found[2:3])


def test_tpv26_has_a_transition_with_depth() -> None:
    stress = Depth.model_validate({
        "density": 2670.0, "fluid_density": 1000.0, "gravity": 9.8, "along": 0.926793, "across": 1.073206,
        "shear": 0.169029, "isotropic": [15e3, 20e3],
    })  # fmt: skip
    found = stress.effective(np.array([[0.0, 0.0, -10e3], [0.0, 0.0, -17.5e3], [0.0, 0.0, -21e3]]))
    P = 1670 * 9.8 * np.array([10e3, 17.5e3, 21e3])
    assert found[:, 1] == pytest.approx(-P * (1 + 0.073206 * np.array([1, 0.5, 0])))
    assert found[:, 3] == pytest.approx(P * 0.169029 * np.array([1, 0.5, 0]), abs=1e-6)


def test_layers_add_up() -> None:
    below = [{"top": 1e3, "density": 2500.0}, {"top": 3e3, "density": 3e3}]
    given = {"density": 2000.0, "gravity": 10.0, "layers": below}
    found = Depth.model_validate(given).effective(np.array([[0.0, -500.0], [0.0, -2e3], [0.0, -4e3]]))
    assert found[:, 1] == pytest.approx([-1e7, -2e7 - 2.5e7, -2e7 - 5e7 - 3e7], rel=1e-14)


def test_all_interfaces_see_one_stress() -> None:
    """A fault and its branch: the tractions are those of the tensor in their own directions."""
    mesh = {
        "kind": "branched_fault", "left": -4e-3, "right": 4e-3, "branch_length": 3e-3, "angle": -35.0,
        "element_size": 1e-3, "beyond": 3e-3,
    }  # fmt: skip
    given = section({"mesh": mesh})
    given["faults"]["branch"] = given["faults"]["main"]
    model = Model(parse_case(given))
    for fault in model.faults:
        normal = fault.interface.frame[:, 0]
        tensor = np.array([[SIX[0], SIX[3]], [SIX[3], SIX[1]]])
        assert -fault.normal_stress_0 == pytest.approx(np.einsum("ni,ij,nj->n", normal, tensor, normal), rel=1e-13)
    assert BulkFields(model).initial_stress.at(np.zeros((1, 2)))[0] == pytest.approx([SIX[0], SIX[1], SIX[3]])


@pytest.mark.parametrize("material", [
    pytest.param(ELASTIC, id="elastic"), pytest.param(YIELDING, id="yielding"),
    pytest.param(METAL, id="metal", marks=pytest.mark.slow),
])  # fmt: skip
def test_bodies_stay_at_rest(material: Table) -> None:
    case = parse_case(table({"materials.default": material}))
    model = Model(case)
    state, motion = model.initial_state(), case.stepper.bind(model)
    for _ in range(20):
        motion.step(state)
    fault = model.faults[0]
    largest = fault.normal_stress_0.max()
    assert 2700 * 5716 * np.abs(state.velocity).max() < 1e-12 * largest
    assert np.abs(state.faults["main"]["normal_stress"] - fault.normal_stress_0).max() < 1e-12 * largest
    for k in (1, 2):
        change = state.faults["main"][f"shear_traction_{k}"] - fault.shear_traction_0[:, k - 1]
        assert np.abs(change).max() < 1e-12 * largest


def test_yield_sees_the_stress_at_its_depth() -> None:
    """A material gets the same stress as one that is given it by profiles of its own."""
    model = Model(parse_case(table({"materials.default": YIELDING})))
    assert model.variation is not None
    cells = np.arange(len(model.bodies.cell_body))
    points = model.variation.points(cells[model.bodies.cell_body == 0])
    values = model.variation.parameters(0, cells[model.bodies.cell_body == 0])
    expected = depth(TPV12).effective(points.reshape(-1, 3))
    for number in range(6):
        assert np.array_equal(values[f"initial_stress.{number}"].ravel(), expected[:, number])
    found = rows(model.case)["plus: initial stress over yield"]
    assert 0.7 < float(found.value) < 0.73


def test_check_finds_what_is_not_in_equilibrium() -> None:
    good = rows(parse_case(table()))
    assert good["initial stress: unbalanced force"].verdict == "ok"
    assert good["faults.main: unbalanced initial traction"].verdict == "ok"
    assert "plus.top: initial load" not in good  # a free surface
    assert "plus.bottom: initial load" in good
    bad = rows(parse_case(table({
        "materials.default.density": 2600.0, "faults.main.initial_stress": {"normal": 120e6, "shear": 70e6},
    })))  # fmt: skip
    force, traction = bad["initial stress: unbalanced force"], bad["faults.main: unbalanced initial traction"]
    assert force.verdict == "warning" and float(force.value) == pytest.approx(980.0, rel=1e-6)
    assert traction.verdict == "warning" and float(traction.value) == pytest.approx(np.hypot(120e6, 70e6), rel=1e-6)


REFUSED: list[tuple[Table, str]] = [
    (table({"initial_stress": {"kind": "uniform", "tensor": [-1e6, -2e6, 3e5]}}),
     r"initial_stress\.tensor = .* 'solid' needs 6 components, .* \[-1e\+06, -2e\+06, ZZ, 300000, YZ, XZ\]"),
    (table({"initial_stress": {"kind": "uniform", "tensor": [-1e6, -2e6, 3e5, 0.0]}}), r"give 6 components"),
    (section({"initial_stress.tensor": SIX[:2] + SIX[3:4], "materials.default": YIELDING}),
     r"initial_stress\.tensor: materials\.default depends on 6 components"),
    (table({"faults.main.initial_stress": {"tensor": SIX}}), r"faults\.main\.initial_stress\.tensor: .* remove one"),
    (table({"materials.default": YIELDING | {"initial_stress": PRESSED}}),
     r"materials\.default\.initial_stress: .* remove one"),
    (section({"initial_stress.tensor": [-1e6, -1e6, -1e6, 40e6, 0.0, 0.0], "materials.default": YIELDING}),
     r"materials\.default\.initial_stress: beyond yield, .* raise cohesion"),
    (section({"initial_stress.tensor": SIX, "materials.default": METAL | {"yield_stress": 50e6}}),
     r"materials\.default\.initial_stress: beyond yield, .* raise yield_stress"),
    (section({"initial_stress.tensor": SIX, "materials.default": DAMAGED}),
     r"materials\.default\.initial_stress: damages from the start, .* raise strength"),
    (table({"initial_stress.fluid_density": 3e3}), r"fluid_density = 3000 kg/m3: .* give less"),
    (table({"initial_stress.isotropic": [2e3, 1e3]}), r"isotropic = .* upper one first"),
    (section({"plane": "antiplane"}), r"initial_stress: not for plane = 'antiplane'; give normal and shear"),
    (table({"faults.main.initial_stress": {"rake": 30.0}}), r"rake = 30: the direction of shear, which is not given"),
    (table({"faults.main.initial_stress": {"shear": 1e6}}), r"normal: the normal stress is missing"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "message"), REFUSED)
def test_wrong_stresses_are_refused(given: Table, message: str) -> None:
    with pytest.raises(CaseError, match=message):
        parse_case(given)


OVERLOADED: list[tuple[Any, str]] = [
    ({"initial_stress.surface": -1e3}, r"initial_stress\.surface = -1000 m: the bodies reach 1000 m higher"),
    ({"initial_stress.across": {"kind": "table", "positions": [0.0, 1e3], "values": [0.5, 0.6]}},
     r"the table from 0 to 1000 m does not cover"),
    ({"materials.default": YIELDING | {"cohesion": 1e3, "friction_angle": 0.2}},
     r"materials\.plus\.initial_stress: beyond yield, .* the worst point is \("),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), OVERLOADED)
def test_a_stress_that_does_not_fit_the_bodies_is_refused(changes: Table, message: str) -> None:
    with pytest.raises(CaseError, match=message):
        Model(parse_case(table(changes)))


@pytest.mark.slow
def test_metals_may_start_without_stress() -> None:
    """They take the stress of the bodies where there is one; `check` then says how near to yield it is."""
    given = section({"initial_stress.tensor": SIX, "materials.default": METAL})
    assert parse_case(given).stressed_materials["default"].initial_stress == SIX
    # q of the tensor over 500 MPa, with the deviator s: q^2 = 3/2 s:s.
    xx, yy, zz, xy, yz, xz = np.array(SIX)
    q = np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * (xy**2 + yz**2 + xz**2))
    assert float(rows(parse_case(given))["upper: initial stress over yield"].value) == pytest.approx(q / 500e6)
    del given["initial_stress"]
    given["faults"]["main"]["initial_stress"] = {"normal": 1e6}
    assert Model(parse_case(given)).given[0].yielded() is None


def test_a_material_that_does_not_know_its_stress_is_refused(tmp_path: Path) -> None:
    plugin = tmp_path / "sand.py"
    plugin.write_text(SAND)
    given = section({"plugins": [str(plugin)], "materials.default": ELASTIC | {"kind": "sand"}})
    message = facts(r"materials\.default: 'sand' does not know an initial stress; .* field `initial_stress`")
    with pytest.raises(CaseError, match=message):
        parse_case(given)


def test_without_any_stress_a_case_is_refused() -> None:
    given = table()
    del given["initial_stress"]
    with pytest.raises(CaseError, match=facts(r"faults\.main\.initial_stress: missing .* \[initial_stress\]")):
        parse_case(given)
    given["faults"]["main"]["initial_stress"] = {"normal": 1e6}
    given["materials"]["default"] = YIELDING
    with pytest.raises(CaseError, match=facts(r"materials\.default\.initial_stress: missing .* \[initial_stress\]")):
        parse_case(given)


def test_three_components_are_completed() -> None:
    assert Uniform(tensor=[1.0, 2.0, 3.0]).everywhere == pytest.approx([1.0, 2.0, 0.0, 3.0, 0.0, 0.0])
