"""Prescribed slip against closed forms, in all steppers, beside friction, and as the record of another run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.compare import largest_difference
from helpers.messages import facts
from helpers.small_cases import HOMALITE, advance, merged
from helpers.whole_runs import whole_and_resumed

from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

STIFF = {"kind": "compliant", "C_n": 3e13, "C_s": 1.2e13}
PLATES = {"kind": "two_plates", "length": 8e-3, "height": 4e-3, "element_size": 2e-3}
BLOCKS = {"kind": "extruded", "section": PLATES, "thickness": 4e-3, "layers": 2}
PATCH = {"kind": "boxcar", "inside": 1e-6, "outside": 0.0, "center": 4e-3, "half_width": 2e-3}


def table(changes: dict[str, Any]) -> dict[str, Any]:
    """Two plates at rest whose whole interface has prescribed slip."""
    given = {
        "plane": "strain", "order": 2, "duration": 4e-6, "mesh": PLATES, "materials": {"default": HOMALITE},
        "output": {"figures": False},
        "faults": {"main": {"contact": {"kind": "split_node"}, "prescribed_slip": [
            {"kind": "gaussian", "slip": PATCH, "width": 4e-7},
        ]}},
        "boundaries": [
            {"kind": "driven", "edge": edge, "component": component, "velocity": 0.0}
            for edge in ("upper.top", "lower.bottom") for component in "xy"
        ],
    }  # fmt: skip
    given = merged(given, changes)
    if given["plane"] == "solid":
        given["boundaries"] += [{**each, "component": "z"} for each in given["boundaries"][::2]]
    return given


@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.parametrize("contact", [{"kind": "split_node"}, STIFF], ids=["split_node", "compliant"])
@pytest.mark.parametrize("stepper", sorted(alternatives("ruptfx.stepping.steppers")))
def test_every_stepper_slips_as_prescribed(stepper: str, contact: dict[str, Any], solid: bool) -> None:
    """Slip is exact at the end of every step, both components; opposite points of rigid contact move by it."""
    if not {"rigid contact", "multipliers"} <= alternatives("ruptfx.stepping.steppers")[stepper].offers:
        contact = STIFF  # takes contact with a stiffness only
    steps = {"petsc_ts": {"courant": 1.0}}.get(stepper, {})
    changes = {"stepper": {"kind": stepper, **steps}, "faults.main.contact": contact}
    if solid:
        slip = {"kind": "gaussian", "slip": PATCH, "width": 4e-7, "rake": 30.0}
        changes |= {"plane": "solid", "mesh": BLOCKS, "faults.main.prescribed_slip": [slip]}
    case = Case.model_validate(table(changes))
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    fault = model.faults[0]
    assert fault.prescribed is not None
    while state.time < case.duration:
        motion.step(state)
        wanted = fault.prescribed.slip(state.fault_time)
        np.testing.assert_allclose(fault.components(state.faults["main"], "slip"), wanted, rtol=0, atol=1e-18)
    assert np.abs(wanted).max() > 0.9e-6 * (np.sqrt(0.75) if solid else 1.0)
    if solid:  # 30 degrees from the first to the second tangent
        np.testing.assert_allclose(wanted[:, 1], np.tan(np.pi / 6) * wanted[:, 0], rtol=1e-12)
    if contact["kind"] == "split_node":
        _, displacement = state.at_faults()
        jump = fault.interface.split(fault.interface.jump(displacement))[1]
        np.testing.assert_allclose(jump, wanted, rtol=0, atol=1e-11 * 1e-6)
    energy = motion.energies(state)
    missing = energy.pop("boundary_work") - sum(energy.values())
    stored = energy["strain"] + energy["kinetic"] + energy["interface_elastic"]
    closure = {"leapfrog": 1e-12, "quasi_static": 1e-9, "quasi_dynamic": 1e-9, "hybrid": 1e-9}.get(stepper)
    assert stored > 1e-6 and energy["prescribed_slip"] < 0
    if closure is not None:
        assert abs(missing) < closure * stored


@pytest.mark.parametrize("plane, modulus", [
    pytest.param("strain", 30e9 / 0.75, marks=pytest.mark.slow), ("antiplane", 30e9),
])  # fmt: skip
def test_traction_of_static_slip(plane: str, modulus: float) -> None:
    """Slip s (1 - x^2 / a^2)^(3/2) in a whole space changes the traction by -3 mu* s / (2 a) (1/2 - x^2 / a^2).

    mu* is mu / (1 - nu) in the plane, mu across it; the far edges, at 20 a, are held.
    """
    x = np.linspace(-1.0, 1.0, 401)
    slip = {"kind": "table", "positions": list(x), "values": list(1e-3 * np.clip(1 - x**2, 0, None) ** 1.5),
            "extend": True}  # fmt: skip
    given = table({
        "plane": plane, "order": 4, "duration": 1.0, "positions": "x",
        "mesh": {
            "kind": "two_plates", "length": 40.0, "left": -20.0, "height": 20.0, "element_size": 0.25, "growth": 1.4,
        },
        "materials.default": {
            "kind": "isotropic_elastic", "young_modulus": 75e9, "poisson_ratio": 0.25, "density": 2700.0,
        },
        "faults.main.prescribed_slip": [{"kind": "ramp", "rise_time": 0.5, "slip": slip}],
        "stepper": {"kind": "quasi_static", "largest_step": 1.0, "first_step": 1.0},
    })  # fmt: skip
    if plane == "antiplane":
        given["boundaries"] = [{**each, "component": "z"} for each in given["boundaries"][::2]]
    case = Case.model_validate(given)
    model = Model(case, fem.MPI.COMM_SELF)
    state = model.initial_state()
    advance(case.stepper.bind(model), state, 1.0)
    face = model.faults[0].interface
    inside = np.abs(face.position) < 0.7
    exact = -1.5e-3 * modulus * (0.5 - face.position[inside] ** 2)
    np.testing.assert_allclose(
        state.faults["main"]["shear_traction"][inside], exact, rtol=0, atol=0.005 * np.abs(exact).max()
    )


def rupturing(solid: bool) -> dict[str, Any]:
    """A rupture under a friction law, with a record in every step."""
    changes = {
        "output.interface_steps": 1, "faults.main.prescribed_slip": [],
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 2e-7},
        "faults.main.initial_stress": {"normal": 6e6, "shear": 3.5e6, **({"rake": 20.0} if solid else {})},
        "faults.main.nucleation": [{"kind": "overstress", "extra": {**PATCH, "inside": 3e5}}],
    }  # fmt: skip
    return table(changes | ({"plane": "solid", "mesh": BLOCKS} if solid else {}))


@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.parametrize("contact", [{"kind": "split_node"}, STIFF], ids=["split_node", "compliant"])
def test_a_recorded_history_gives_the_tractions_of_its_run(
    contact: dict[str, Any], solid: bool, tmp_path: Path
) -> None:
    given = merged(rupturing(solid), {"faults.main.contact": contact})
    simulate(parse_case(given), tmp_path / "first", progress=False)
    given["faults"]["main"]["prescribed_slip"] = [{"kind": "table", "file": "first/interface.h5"}]
    simulate(parse_case(given, tmp_path), tmp_path / "second", progress=False)
    with h5py.File(tmp_path / "first" / "interface.h5") as one, h5py.File(tmp_path / "second" / "interface.h5") as two:
        names = [name for name in one if name.startswith(("shear_traction", "normal_stress"))]
        assert len(names) == (3 if solid else 2) and max(np.abs(one[name]).max() for name in one if "slip" in name) > 1
        for name in names:  # all but the last record, beyond which the history is not known
            np.testing.assert_allclose(two[name][:-1], one[name][:-1], rtol=0, atol=1e-10 * 6e6)


@pytest.mark.parametrize("stepper", ["leapfrog", "quasi_static"])
def test_friction_acts_beside_it(stepper: str) -> None:
    """One half slips as prescribed and pushes the other half, which slides under Coulomb friction."""
    slip = {"kind": "gaussian", "slip": 2e-6, "width": 3e-7, "where": {
        "kind": "boxcar", "inside": 1.0, "outside": 0.0, "center": 0.0, "half_width": 4e-3}}  # fmt: skip
    case = Case.model_validate(table({
        "faults.main.prescribed_slip": [slip], "faults.main.friction": {"kind": "coulomb", "mu_d": 0.5},
        "faults.main.initial_stress": {"normal": 4e6, "shear": 1.9e6}, "stepper": {"kind": stepper},
    }))  # fmt: skip
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    advance(motion, state, case.duration)
    fault, fields = model.faults[0], state.faults["main"]
    held = fault.interface.position <= 4e-3
    assert fault.prescribed is not None
    np.testing.assert_array_equal(fault.prescribed.held, held)
    np.testing.assert_allclose(fields["slip"][held], 2e-6, rtol=1e-9)
    assert fields["slip"][~held].max() > 1e-7 and fields["slip"][~held].min() >= 0
    strength = 0.5 * fields["normal_stress"]
    assert np.all(np.abs(fields["shear_traction"][~held]) <= strength[~held] * (1 + 1e-9))
    assert state.energy["frictional_dissipation"] > 0


def test_a_resumed_run_has_the_same_bits(tmp_path: Path) -> None:
    given = parse_case(table({"output.checkpoint_steps": 7}))
    whole, resumed = whole_and_resumed(given, tmp_path)
    assert max(largest_difference(whole, resumed).values()) == 0


@pytest.mark.parametrize("entry, reason", [
    ({"kind": "constant_rate", "rate": 0.01}, r"prescribed_slip.* 0.01 m/s .* output.rupture_threshold = 0.001"),
    ({"kind": "ramp", "slip": 1e-6, "rise_time": 1e-6, "rake": 10.0}, r"prescribed_slip.0: rake = 10"),
    ({"kind": "table", "file": "beyond.csv"}, r"prescribed_slip.0: .*beyond.csv.* 0.009 m.* 0 to 0.008 m"),
    ({"kind": "table", "file": "late.csv"}, r"prescribed_slip: .* 1e-06 m at time 0"),
    ({"kind": "table", "file": "unit.csv"}, r"column 3.*kg"),
    ({"kind": "table", "file": "header.csv"}, r"header.csv: needs time, position and slip"),
    ({"kind": "table", "file": "missing.csv"}, r"missing.csv: cannot be read"),
])  # fmt: skip
def test_refused(entry: dict[str, Any], reason: str, tmp_path: Path) -> None:
    for name, header, rows in (
        ("beyond", "time, position, slip", "0, 0.001, 0\n0, 0.009, 0\n1e-6, 0.001, 0\n1e-6, 0.009, 1e-6"),
        ("late", "time, position, slip", "0, 0.001, 1e-6\n0, 0.003, 0\n1e-6, 0.001, 1e-6\n1e-6, 0.003, 1e-6"),
        ("unit", "time, position, slip (kg)", "0, 0.001, 0\n1e-6, 0.001, 0"),
        ("header", "time, place, slip", "0, 0.001, 0\n1e-6, 0.001, 0"),
    ):
        (tmp_path / f"{name}.csv").write_text(f"{header}\n{rows}\n")
    with pytest.raises(CaseError, match=facts(reason)):
        Model(parse_case(table({"faults.main.prescribed_slip": [entry]}), tmp_path), fem.MPI.COMM_SELF)


def test_slip_where_boundaries_drive_both_sides_is_refused() -> None:
    """The ends of the interface are driven apart at 1 m/s, and slip is 1 um there: slip with the edges is right."""
    edges = [{"kind": "driven", "edge": f"{body}.left", "component": "x", "velocity": speed}
             for body, speed in (("upper", 0.5), ("lower", -0.5))]  # fmt: skip
    slip = {"kind": "ramp", "slip": 1e-6, "rise_time": 1e-6}
    with pytest.raises(CaseError, match=facts(r"faults.main.prescribed_slip: .* m at time .* s at \(0, 0\) m")):
        Model(Case.model_validate(table({"boundaries": edges, "faults.main.prescribed_slip": [slip]})))
    slip = {"kind": "constant_rate", "rate": 1.0}
    slow = {"boundaries": edges, "faults.main.prescribed_slip": [slip], "stepper": {"kind": "quasi_static"}}
    assert Model(Case.model_validate(table(slow))).faults[0].is_held.all()


def test_creep_begins_at_once_without_inertia() -> None:
    """Nothing radiates there; slip grows at its rate from the first step on."""
    entry = {"kind": "constant_rate", "rate": 0.01}
    case = Case.model_validate(table({"faults.main.prescribed_slip": [entry], "stepper": {"kind": "quasi_static"}}))
    model = Model(case, fem.MPI.COMM_SELF)
    state = model.initial_state()
    advance(case.stepper.bind(model), state, 1e-6)
    np.testing.assert_allclose(state.faults["main"]["slip"], 0.01 * state.time, rtol=1e-12)
    np.testing.assert_allclose(state.faults["main"]["slip_rate"], 0.01, rtol=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("stepper", ["leapfrog", "quasi_dynamic", "quasi_static"])
def test_same_on_any_number_of_ranks(stepper: str) -> None:
    case = Case.model_validate(table({"stepper": {"kind": stepper}, "faults.main.contact": STIFF}))
    ends = []
    for comm in (fem.MPI.COMM_WORLD, fem.MPI.COMM_SELF):
        model = Model(case, comm)
        motion, state = case.stepper.bind(model), model.initial_state()
        advance(motion, state, case.duration)
        face, fields = model.faults[0].interface, state.faults["main"]
        rows = np.column_stack([face.number, fields["slip"], fields["shear_traction"]])[face.owned]
        rows = parallel.share_rows(comm, rows)
        ends.append((rows[np.argsort(rows[:, 0])], motion.energies(state)["prescribed_slip"]))
    (ours, work), (theirs, alone) = ends
    np.testing.assert_allclose(ours[:, 1], theirs[:, 1], rtol=0, atol=1e-18)
    np.testing.assert_allclose(ours[:, 2], theirs[:, 2], rtol=0, atol=1e-9 * np.abs(theirs[:, 2]).max())
    assert work == pytest.approx(alone, rel=1e-9) and work < 0


# Two subfaults of 2 x 2 km, slip 1 m each: rake 30 degrees, then 90 (reverse). The second one begins 1 s later.
SRF = """1.0
PLANE 1
 -118 34 2 1 4.0 2.0
 0 60 0 0 1
POINTS 2
 -118 34 1 0 60 4e10 0.5 0.1
 30 100 3 0 0 0 0
 250 500 250
 -118 34 1 0 60 4e10 1.5 0.1
 90 100 3 0 0 0 0
 250 500 250
"""
FSP = """% Mech : STRK = 0  DIP = 60  RAKE = 30  Htop = 0 km
% Invs : Nx = 2  Nz = 1
% Invs : Dx = 2.0 km  Dz = 2.0 km
% LAT LON X==EW Y==NS Z SLIP RAKE TRUP RISE
 34 -118 0 1 0 1.0 30 0.5 0.4
 34 -118 0 3 0 1.0 90 1.5 0.4
"""


@pytest.mark.parametrize("dip", [60.0, 90.0])
@pytest.mark.parametrize("kind, text", [("srf", SRF), ("fsp", FSP)])
def test_finite_faults_are_placed_and_directed(kind: str, text: str, dip: float, tmp_path: Path) -> None:
    """The strike has the dip to its right: against x where the fault dips to +y, along x on a vertical one.

    Slip of the hanging wall, which is `plus` of the dipping fault, is cos 30 along the strike and sin 30 up dip in the
    first subfault, and up dip in the second one.
    """
    (tmp_path / f"model.{kind}").write_text(text)
    mesh = {"kind": "box_with_fault", "fault_length": 4e3, "fault_width": 2e3, "element_size": 500.0, "beyond": 1e3,
            "distance": 1e3, "dip": dip}  # fmt: skip
    given = table({"mesh": mesh, "faults.main.prescribed_slip": [
        {"kind": kind, "file": f"model.{kind}"}], "duration": 3.0, "positions": "x"})  # fmt: skip
    given |= {"plane": "solid", "boundaries": []}
    fault = Model(parse_case(given, tmp_path), fem.MPI.COMM_SELF).faults[0]
    slip, face, sign = fault.prescribed, fault.interface, -1.0 if dip == 60 else 1.0
    assert slip is not None and slip.held.all()
    x = face.position * sign  # along the strike, from the middle of the model

    def at(place: float, time: float) -> np.ndarray:
        return np.asarray(slip.slip(time)[np.argmin(np.abs(x - place) + np.abs(face.across - 1e3))])

    # The plus side is the hanging wall of the dipping fault; on the vertical one it is the foot wall.
    wall = np.array([sign, -1.0]) * (1.0 if dip == 60 else -1.0)
    np.testing.assert_allclose(at(-1e3, 3.0), wall * (np.sqrt(0.75), 0.5), atol=1e-12)
    np.testing.assert_allclose(at(1e3, 3.0), wall * (0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(at(0.0, 3.0), wall * (0.5 * np.sqrt(0.75), 0.75), atol=1e-12)
    assert not at(-1e3, 0.39).any() and at(-1e3, 0.6).any()  # half-way between both, slip begins half-way in time
    assert not at(0.0, 0.89).any() and at(0.0, 1.1).any() and not at(1e3, 1.39).any()
