"""Gradients: of every friction law and contact method, against differences of runs, on ranks, and what is refused."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.messages import facts
from helpers.small_cases import COMPLIANT, SPLIT, friction_laws, merged, slip_weakening, strike_slip

from ruptfx.app.check_law.examples import friction
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.readings.misfits import Sample, Unknown

pytest.importorskip("dolfinx")

from benchmarks import adjoint as bench
from benchmarks.time_order import CONTACTS, LAWS
from ruptfx import RuptfxError, gradient
from ruptfx.many_runs.adjoint.bodies import value_of
from ruptfx.many_runs.adjoint.checkpoints import passed, schedule, split
from ruptfx.many_runs.adjoint.comparison import disagree
from ruptfx.many_runs.adjoint.figure import draw
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.many_runs.adjoint.sweeps import Sweeps
from ruptfx.many_runs.adjoint.unknowns import hats, perturbed, places
from ruptfx.platform import fem, launch
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

SLIP = [{"kind": "final_slip", "sigma": 1e-6}]
RUPTURE = {"duration": 14e-6, "objective": SLIP}


def of_examples(kind: str, wrapped: str | None) -> dict[str, Any]:
    """Example of a law, without the initial slip rate where the state is given, too."""
    law = friction(kind, wrapped).model_dump(mode="json", exclude_none=True)
    inner = law
    while "law" in inner:
        inner = inner["law"]
    if {"theta_initial", "psi_initial", "psi_1_initial"} & inner.keys():
        inner.pop("V_initial", None)
    return law


def reproduced(sweeps: Sweeps) -> tuple[float, float]:
    """Largest difference of the traced steps from the compiled ones, and the share of sliding points and steps."""
    points, rows, worst, sliding = sweeps.points[0], sweeps.made.histories[0].rows, 0.0, 0.0
    local, width = points.local, len(points.memory)
    for step in range(sweeps.steps):
        kick = min(step, 2)
        found = points.found(rows[step], rows[step + 1], sweeps.clocks[kick])
        outputs = points.value(kick, sweeps.clocks[kick], rows[step], sweeps.loaded(0, step * sweeps.dt), found)
        new, wanted = outputs[local : local + width], rows[step + 1][2 * local :]
        size = np.abs(wanted).max(axis=1, keepdims=True)
        worst = max(worst, float((np.abs(new - wanted) / np.where(size > 0, size, 1.0)).max()))
        sliding += float(np.mean((found[-2] == 0) & (found[-1] == 0))) / sweeps.steps
    return worst, sliding


@pytest.mark.parametrize("kind, wrapped", [law for law in friction_laws() if law[1] in (None, "coulomb")])
@pytest.mark.parametrize("contact", CONTACTS)
def test_every_law_and_contact_has_exact_transposes(kind: str, wrapped: str | None, contact: str) -> None:
    case = bench.sliding_plates(of_examples(kind, wrapped), CONTACTS[contact], "strain", steps=60)
    worst, sliding = reproduced(Objective(case, case.objective, fem.MPI.COMM_SELF).sweeps)
    assert worst < 1e-12
    assert sliding > 0.02
    assert bench.mismatch(case, fem.MPI.COMM_SELF) < 1e-12


@pytest.mark.parametrize("plane", ["stress", "antiplane"])
@pytest.mark.parametrize("contact", CONTACTS)
def test_every_plane_has_exact_transposes(plane: str, contact: str) -> None:
    case = bench.sliding_plates(LAWS["rate_and_state_ageing"], CONTACTS[contact], plane, steps=60)
    assert bench.mismatch(case, fem.MPI.COMM_SELF) < 1e-12


def test_a_step_of_zero_length_keeps_the_slip_rate() -> None:
    case = bench.sliding_plates(LAWS["rate_and_state_ageing"], CONTACTS["compliant"], "strain", steps=60)
    sweeps = Objective(case, case.objective, fem.MPI.COMM_SELF).sweeps
    points, rows = sweeps.points[0], sweeps.made.histories[0].rows
    found = points.found(rows[0], rows[1], sweeps.clocks[0])
    outputs = points.value(0, sweeps.clocks[0], rows[0], sweeps.loaded(0, 0.0), found)
    before = rows[0][points.history.index("mean_slip_rate_0")]
    assert (before > 0).all()
    np.testing.assert_array_equal(outputs[points.outputs.index("slip_rate_0")], before)


def differences(case: Case, shape: Any, sizes: dict[str, float], step: float) -> dict[str, tuple[float, float]]:
    """Slopes of the objective along changes of every parameter: by the gradient, and by central differences."""
    model = Model(case).in_steps("explicit")
    exact = gradient(case, progress=False)
    position = model.faults[0].interface.position
    found = {}
    for key, place in places(model).items():
        if place.of_contact:
            continue
        change = sizes[place.unit] * shape(position)
        values = [
            Objective(
                case,
                case.objective,
                record=False,
                model=perturbed(model, {(0, row): sign * step * part * change for row, part in place.rows}),
            ).value
            for sign in (1, -1)
        ]
        found[key] = float(exact[key].values @ change), (values[0] - values[1]) / (2 * step)
    return found


@pytest.mark.parametrize("changes", [
    {}, {"faults.main.contact": COMPLIANT}, {"damping.kelvin_voigt": {"fraction": 0.2}, "plane": "strain"},
    {"damping.mass": 2e4, "operator": "ufl_form", "boundaries": [{"kind": "absorbing", "edge": "upper.top"}]},
    {"boundaries": [{"kind": "spring", "edge": "upper.top", "normal": 1e12, "tangential": 1e12}]},
])  # fmt: skip
def test_gradients_through_a_rupture_equal_central_differences(changes: dict[str, Any]) -> None:
    case = parse_case(slip_weakening({**RUPTURE, **changes}))
    sizes = {"Pa": 1e6, "m": 1e-6, "1": 0.1}
    found = differences(case, lambda x: np.cos(400 * x), sizes, 1e-6)
    assert len(found) == 5
    largest = max(abs(exact) for exact, _ in found.values())
    for key, (exact, difference) in found.items():  # differences have rounding errors
        assert exact == pytest.approx(difference, rel=1e-5, abs=1e-7 * largest), key


def test_gradients_by_contact_stiffness_equal_central_differences() -> None:
    """At the same time step, which would depend on it."""
    case = parse_case(slip_weakening({**RUPTURE, "faults.main.contact": COMPLIANT}))
    case = bench.fixed(case, fem.MPI.COMM_SELF, 0.9)
    exact = gradient(case, progress=False)
    for name in ("C_n", "C_s"):
        key = f"faults.main.contact.{name}"
        value = getattr(case.faults["main"].contact, name)
        both = [
            Objective(other, other.objective, record=False).value
            for other in (case.changed(key, value * (1 + sign * 1e-6)) for sign in (1, -1))
        ]
        assert exact[key].attrs["units"] == "1/(Pa/m)"
        slope = float(exact[key].sum()) * value
        assert slope == pytest.approx((both[0] - both[1]) / 2e-6, rel=1e-4), key
        assert slope != 0


OPENING = [{"kind": "traction", "edge": edge, "traction": [0.0, pull], "ramp": 3e-6}
           for edge, pull in (("upper.top", 9e6), ("lower.bottom", -9e6))]  # fmt: skip
CLOSING = [
    {"kind": "traction", "edge": "upper.top", "traction": [2e6, -9e6], "ramp": 3e-6},
    *({"kind": "driven", "edge": "lower.bottom", "component": each, "velocity": 0.0} for each in "xy"),
]
GAP = {"boundaries": CLOSING, "faults.main.gap": 1e-9, "faults.main.initial_stress": {"normal": 0.0},
       "faults.main.friction": {"kind": "coulomb", "mu_d": 0.2}}  # fmt: skip


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=["split_node", "compliant"])
@pytest.mark.parametrize("changes, sizes", [
    ({"boundaries": OPENING}, {"Pa": 1e6, "m": 1e-6, "1": 0.1}), (GAP, {"Pa": 1e4, "1": 0.1}),
], ids=["opens", "closes"])  # fmt: skip
def test_gradients_of_interfaces_that_open_or_close(changes: Any, sizes: Any, contact: Any) -> None:
    """Open points move freely from rest, where the direction of their motion is not defined."""
    case = parse_case(slip_weakening({**RUPTURE, **changes, "faults.main.contact": contact}))
    sweeps = Objective(case, case.objective).sweeps
    sigma = sweeps.made.histories[0].rows[:, sweeps.points[0].history.index("normal_stress")]
    assert 0.2 < np.mean(sigma <= 0) < 0.9
    assert reproduced(sweeps)[0] < 1e-12
    assert bench.mismatch(case, fem.MPI.COMM_SELF) < 1e-12
    found = differences(case, lambda x: np.cos(400 * x), sizes, 1e-6)
    largest = max(abs(exact) for exact, _ in found.values())
    for key, (exact, difference) in found.items():
        assert exact == pytest.approx(difference, rel=1e-4, abs=1e-7 * largest), key


AGEING = {"kind": "rate_and_state_ageing", "a": 0.008, "b": 0.012, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6,
          "V_initial": 1e-6}  # fmt: skip
PULLED = [
    {"kind": "traction", "edge": edge, "traction": [0.0, pull],
     "history": {"kind": "sampled", "times": [0.0, 2e-6, 4e-6, 1e-5], "values": [0.0, 1.0, -0.5, -0.5]}}
    for edge, pull in (("upper.top", 9e6), ("lower.bottom", -9e6))
]  # fmt: skip


def test_the_state_of_open_points_depends_on_how_they_move() -> None:
    """It evolves with their free slip rate, and counts when they have closed again."""
    changes = {"boundaries": PULLED, "faults.main.friction": AGEING, "objective": SLIP, "faults.main.contact": SPLIT}
    case = parse_case(slip_weakening({**RUPTURE, **changes}))
    sweeps = Objective(case, case.objective).sweeps
    sigma = sweeps.made.histories[0].rows[:, sweeps.points[0].history.index("normal_stress")]
    assert np.mean(sigma <= 0) > 0.1 and np.all(sigma[-1] > 0)
    assert reproduced(sweeps)[0] < 1e-12
    assert bench.mismatch(case, fem.MPI.COMM_SELF) < 1e-12


KNOWN = [
    {"kind": "given", "pressure": 1e6, "begin": 1e-6, "end": 5e-6, "rise": 1.7e-6},
    {"kind": "given", "pressure": 5e5, "history": {"kind": "sampled", "times": [0.0, 1e-5], "values": [1.0, 2.0]}},
]
WET = {"duration": 8e-6, "objective": SLIP, "faults.main.friction": AGEING, "faults.main.pore_pressure": KNOWN}


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=["split_node", "compliant"])
def test_gradients_by_a_known_pore_pressure_equal_central_differences(contact: Any) -> None:
    """The initial state follows from the effective stress; the ageing law has no kinks."""
    case = parse_case(slip_weakening({**WET, "faults.main.contact": contact}))
    assert bench.mismatch(case, fem.MPI.COMM_SELF) < 1e-12
    sizes = {"Pa": 1e6, "m": 1e-6, "m/s": 1e-6, "1": 0.01, "s": 1e-6}
    results = differences(case, lambda x: 1 + 0.5 * np.cos(400 * x), sizes, 1e-5)
    own = {key: values for key, values in results.items() if "pore_pressure" in key}
    assert sorted(key.removeprefix("faults.main.pore_pressure.") for key in own) == [
        "0.begin", "0.end", "0.pressure", "0.rise", "1.pressure"]  # fmt: skip
    for key, (exact, difference) in own.items():
        assert exact == pytest.approx(difference, rel=1e-8), key
    for key in ("faults.main.initial_stress.normal", "faults.main.friction.a"):
        assert results[key][0] == pytest.approx(results[key][1], rel=1e-8), key


def test_a_pore_pressure_that_diffuses_leaves_gradients_by_other_parameters_exact() -> None:
    """It does not depend on the motion where neither the permeability nor the porosity does."""
    layer = {"kind": "diffusion", "permeability": 1e-13, "viscosity": 1e-3, "compressibility": 1e-8, "porosity": 0.1,
             "thickness": 1.0, "wells": [{"center": 16e-3, "rate": 1e-5}]}  # fmt: skip
    case = parse_case(slip_weakening({**WET, "faults.main.contact": SPLIT, "faults.main.pore_pressure": layer}))
    results = differences(case, lambda x: 1 + 0.5 * np.cos(400 * x), {
        "Pa": 1e6, "m": 1e-6, "m/s": 1e-6, "1": 0.01}, 1e-5)  # fmt: skip
    for key in ("faults.main.initial_stress.shear", "faults.main.initial_stress.normal", "faults.main.friction.a"):
        assert results[key][0] == pytest.approx(results[key][1], rel=1e-8), key


FOLLOWS = {
    "thermal_pressurisation": {}, "dilatancy": {},
    "diffusion": {"dilatancy": 1e-4}, "permeability": {"stress_scale": 1e6},
}  # fmt: skip


@pytest.mark.parametrize("kind", FOLLOWS)
def test_pressures_that_follow_the_motion_are_refused_with_remedies_that_work(kind: str) -> None:
    import tomllib

    kinds = alternatives("ruptfx.interfaces.pore_pressure")
    own = tomllib.loads(f"x = {kinds['diffusion' if kind == 'permeability' else kind].example}")["x"] | FOLLOWS[kind]
    table = slip_weakening({**WET, "faults.main.pore_pressure": own})
    with pytest.raises(CaseError, match=facts("remove faults.main.pore_pressure, or remove objective")):
        parse_case(table)
    with_given = merged(table, {"faults.main.pore_pressure": {"kind": "given", "pressure": 1e6}})
    for changed in (merged(table, {"faults.main.pore_pressure": []}), merged(table, {"objective": []}), with_given):
        Model(parse_case(changed))


def test_gradients_around_an_axis_equal_central_differences() -> None:
    case = parse_case(slip_weakening({
        "plane": "axisymmetric", "order": 2, "duration": 6e-6, "objective": SLIP, "mesh": {
            "kind": "fibre_in_matrix", "radius": 4e-3, "outer_radius": 8e-3, "length": 16e-3, "element_size": 1e-3},
        "faults.main.initial_stress.shear.center": 8e-3,
    }))  # fmt: skip
    for key, (exact, difference) in differences(case, lambda x: np.cos(400 * x), {"Pa": 1e6, "m": 1e-6, "1": 0.1},
                                                1e-6).items():  # fmt: skip
        assert exact == pytest.approx(difference, rel=1e-6), key


def test_gradients_by_nucleations_equal_central_differences() -> None:
    """One that weakens friction, whose law is inside of another one, and one that adds stress."""
    case = parse_case(slip_weakening({
        **RUPTURE, "faults.main.initial_stress.shear.inside": 3.2e6, "faults.main.nucleation": [
            {"kind": "friction_drop", "mu_d": 0.1, "center": 16e-3, "half_width": 3e-3, "t_w": 3e-6},
            {"kind": "smooth_patch", "extra": 1e6, "center": 16e-3, "radius": 4e-3, "rise": 4e-6},
        ],
    }))  # fmt: skip
    model = Model(case).in_steps("explicit")
    exact, known = gradient(case, progress=False), places(model)
    shape = np.cos(300 * model.faults[0].interface.position)
    sizes = {"Pa": 1.0, "m": 1e-11, "1": 5e-7, "s": 1e-12}
    for key in ("nucleation.0.mu_d", "nucleation.0.t_w", "nucleation.1.extra", "friction.mu_s", "friction.D_c"):
        place = known[f"faults.main.{key}"]
        change = sizes[place.unit] * shape
        values = [Objective(case, case.objective, record=False, model=perturbed(
            model, {(0, row): sign * part * change for row, part in place.rows},
            {(0, 1): sign * change} if place.nucleation else {})).value for sign in (1, -1)]  # fmt: skip
        slope = float(exact[place.key].values @ change)
        assert slope == pytest.approx(0.5 * (values[0] - values[1]), rel=1e-5), key


def test_times_of_a_nucleation_are_no_unknowns() -> None:
    """The end of a normal stress drop is its begin plus its duration, and moves with it."""
    drop = {"kind": "normal_stress_drop", "center": 16e-3, "half_width": 3e-3, "drop": 3e6, "duration": 4e-6,
            "rise": 1e-6}  # fmt: skip
    case = parse_case(slip_weakening({**RUPTURE, "faults.main.nucleation": [drop]}))
    known = places(Model(case).in_steps("explicit"))
    assert "faults.main.nucleation.0.rise" in known
    assert not {"faults.main.nucleation.0.begin", "faults.main.nucleation.0.end"} & known.keys()


@pytest.mark.slow  # and the benchmark `adjoint`
def test_remainders_of_a_rupture_without_kinks_are_of_second_order() -> None:
    made = bench.Remainders(fem.MPI.COMM_SELF, ["density", "c_s"])
    assert made.least_order > 1.95
    assert made.least_order_of_bodies > 1.95
    assert set(made.found) == {*bench.KINDS, "density", "c_s"}


@pytest.mark.slow
def test_remainders_of_a_rupture_in_three_dimensions_are_of_second_order() -> None:
    """With 30 % of the memory of its history."""
    made = bench.Remainders(fem.MPI.COMM_SELF, (), bench.rupture_3d(), bench.PART)
    assert made.least_order > 1.95
    assert made.memory <= 1


def test_tangent_linear_sweeps_equal_central_differences() -> None:
    assert bench.central_differences(2, fem.MPI.COMM_SELF) < 1e-6


def test_gradients_in_three_dimensions() -> None:
    case = parse_case(strike_slip({"objective": SLIP, "duration": 2e-6}))
    assert bench.mismatch(case, fem.MPI.COMM_SELF) < 1e-12
    found = differences(case, lambda x: np.cos(400 * x), {"Pa": 1e6, "m": 1e-6, "1": 0.1}, 1e-6)
    for key, (exact, difference) in found.items():
        assert exact == pytest.approx(difference, rel=1e-6), key


def velocimeter(point: list[float], direction: list[float]) -> dict[str, Any]:
    """An instrument in the bodies, and an objective of its traces."""
    along = {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": point, "direction": direction}
    data = {"kind": "traces", "instrument": "body", "times": [4e-6, 6e-6], "data": {"velocity": [0.1, 0.2]},
            "units": {"velocity": "m/s"}, "sigma": 0.1}  # fmt: skip
    return {"instruments": [along], "objective": [data]}


STIFF = {"kind": "isotropic_elastic", "young_modulus": 7e9, "poisson_ratio": 0.3, "density": 1.5e3}
BODIES = {
    "two_bodies": slip_weakening({
        "duration": 8e-6, **velocimeter([18e-3, 2e-3], [1.0, 0.0]), "materials.upper": STIFF,
        "damping.kelvin_voigt": {"eta": 5e-8}, "faults.main.contact": SPLIT, "boundaries": [
            {"kind": "sponge", "edge": "upper.top", "width": 2e-3}, {"kind": "absorbing", "edge": "lower.bottom"},
            {"kind": "gravity", "acceleration": [1e5, -3e5], "ramp": 2e-6}]}),
    "antiplane": slip_weakening({
        "plane": "antiplane", "duration": 8e-6, **velocimeter([18e-3, 2e-3], [1.0]), "operator": "ufl_form",
        "damping.mass": 2e4, "boundaries": [
            {"kind": "body_spring", "body": "upper", "width": 20e-3},
            {"kind": "driven", "edge": "lower.bottom", "component": "z", "velocity": 0.1}]}),
    "solid": strike_slip({"objective": SLIP, "duration": 1e-6, "boundaries": [
        {"kind": "absorbing", "edge": "plus.far"}]}),
}  # fmt: skip


@pytest.mark.parametrize("name, constants", [
    ("two_bodies", ["upper.density", "upper.poisson_ratio", "default.c_p"]),
    ("antiplane", ["default.density", "default.c_s"]), ("solid", ["default.c_p"]),
])  # fmt: skip
def test_gradients_by_constants_of_bodies_equal_central_differences(name: str, constants: list[str]) -> None:
    case = bench.fixed(parse_case(BODIES[name]), fem.MPI.COMM_SELF, 0.9)
    keys = [f"materials.{each}" for each in constants]
    exact = gradient(case, unknowns=keys, progress=False)
    for key in keys:
        _, material, constant = key.split(".")
        step = 1e-5 * value_of(case.materials[material], constant)
        values = []
        for sign in (1, -1):
            other = bench.changed_bodies(case, material, constant, sign * step)
            values.append(Objective(other, other.objective, record=False).value)
        assert exact[key].ndim == 0
        assert float(exact[key]) == pytest.approx((values[0] - values[1]) / (2 * step), rel=2e-6), key


@pytest.mark.slow
def test_a_gradient_is_the_same_on_two_ranks_with_a_tenth_of_the_memory() -> None:
    assert bench.of_ranks(2, 0.1) < 1e-10


@pytest.mark.parametrize("kind", MISFITS := alternatives("ruptfx.readings.misfits"))
def test_every_misfit_has_exact_derivatives(kind: str) -> None:
    """Of its value by its readings, and through a run."""
    import tomllib

    table = tomllib.loads(f"example = {MISFITS[kind].example}")["example"]
    instruments = [{"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 5.3e-3}]
    case = bench.sliding_plates(LAWS["rate_and_state_ageing"], CONTACTS["split_node"], "stress", steps=60)
    case = parse_case({**case.table(), "instruments": instruments, "objective": [table]})
    made = Objective(case, case.objective, fem.MPI.COMM_SELF)
    (term,), samples = case.objective, [sample for _, sample in made.samples]
    made.terms[0].requests(ModelReadings(made.model, lambda points: np.zeros((len(points), 6))), "objective.0")
    value, slopes = made.terms[0].evaluate(samples)
    random = np.random.default_rng(0)
    change = [random.normal(size=len(each.values)) * np.abs(each.values).max() for each in samples]
    both = [made.terms[0].evaluate([
        Sample(each.at, each.values + sign * 1e-6 * by, each.weights) for each, by in zip(samples, change, strict=True)
    ])[0] for sign in (1, -1)]  # fmt: skip
    slope = sum(float(a @ b) for a, b in zip(slopes, change, strict=True))
    assert slope == pytest.approx((both[0] - both[1]) / 2e-6, rel=1e-6)
    assert value == made.value
    uneven = [Sample(each.at, each.values + by, random.uniform(0.5, 2.0, len(each.weights)))
              for each, by in zip(samples, change, strict=True)]  # fmt: skip
    value, slopes = made.terms[0].evaluate(uneven)
    if (residuals := made.terms[0].residuals(uneven)) is not None:  # half their squares are the value
        assert sum(0.5 * float(r @ r) for r, _ in residuals) == pytest.approx(value, rel=1e-12) and value > 0
        for (r, factor), of_values in zip(residuals, slopes, strict=True):
            np.testing.assert_allclose(r * factor, of_values, rtol=1e-12)
    assert any(np.any(each.values) for each in made.gradient())
    assert term.kind() == kind


def test_data_are_read_from_files_with_units(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("time (us),slip (um),slip_rate (m/s)\n1,0.5,0\n2,1.5,0.1\n")
    term = {"kind": "traces", "instrument": "fault", "file": "data.csv", "sigma": 1e-6, "channels": ["slip"]}
    table = slip_weakening(
        {
            "objective": [term],
            "instruments": [{"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 16e-3}],
        }
    )
    made = parse_case(table, tmp_path)
    assert made.objective[0].times == pytest.approx([1e-6, 2e-6], rel=1e-15)
    assert made.objective[0].units["slip"] == "um"
    found = Objective(made, made.objective)
    reading = found.samples[0][1].values
    assert found.value == pytest.approx(0.5 * np.sum((reading - [0.5e-6, 1.5e-6]) ** 2) / 1e-12)
    assert parse_case(made.table()).objective == made.objective  # the data are in the case
    (tmp_path / "data.csv").write_text("time,slip\n1,0.5\n2,1.5\n")
    with pytest.raises(CaseError, match=facts(r"objective\.0: line 1 of .*data\.csv, column 1, 'time': has no unit")):
        parse_case(table, tmp_path)
    (tmp_path / "data.csv").write_text("time (us),slip (kg)\n1,0.5\n2,1.5\n")
    other = parse_case(table, tmp_path)
    message = r"objective\.0\.units\.slip = 'kg' .*'slip' of .*data\.csv.* in m .*; write m or"
    with pytest.raises(CaseError, match=facts(message)):
        Objective(other, other.objective)


FAULT = {"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 16e-3}
TRACE = {"kind": "traces", "instrument": "fault", "times": [1e-6], "data": {"slip": [0.0]}, "units": {"slip": "m"},
         "sigma": 1e-6}  # fmt: skip


@pytest.mark.parametrize("window, kept", [({"begin": 2e-6}, [1, 2]), ({"end": 2e-6}, [0, 1]),
                                          ({"begin": 1.5e-6, "end": 2.5e-6}, [1])])  # fmt: skip
def test_data_outside_of_their_window_do_not_count(window: dict[str, float], kept: list[int]) -> None:
    times, slips = [1e-6, 2e-6, 3e-6], [0.5e-6, 1.5e-6, -2.0e-6]
    made = slip_weakening(
        {"instruments": [FAULT], "objective": [{**TRACE, "times": times, "data": {"slip": slips}, **window}]}
    )
    found = Objective(parse_case(made), parse_case(made).objective)
    sample = found.samples[0][1]
    assert sample.at == pytest.approx([times[i] for i in kept], rel=1e-15)
    assert found.value == pytest.approx(0.5 * np.sum((sample.values - [slips[i] for i in kept]) ** 2) / 1e-12)


@pytest.mark.parametrize("shift", [0.0, 0.5e-6])
def test_data_outside_of_the_run_are_refused_with_their_number(shift: float) -> None:
    times = [-2e-6, -1e-6, 1e-6, 3e-6, 21e-6]
    term = {**TRACE, "times": times, "data": {"slip": [1.0, 1.0, 0.0, 0.0, 1.0]}, "time_shift": shift}

    def objective(**window: float) -> Objective:
        case = parse_case(slip_weakening({"instruments": [FAULT], "objective": [{**term, **window}]}))
        return Objective(case, case.objective)

    duration = parse_case(slip_weakening()).duration
    assert 4e-6 < duration < 20e-6
    begin, end = 0.0 - shift, duration - shift
    message = rf"objective\.0\.times: .* 2 before it and 1 after its end, of 5 .* begin = {begin:g} .* end = {end:.12g}"
    with pytest.raises(CaseError, match=facts(message)):
        objective()
    with pytest.raises(CaseError, match=facts(r"objective\.0\.times: .* 2 before it, of 4 times.* begin = ")):
        objective(end=end)
    np.testing.assert_allclose(objective(begin=begin, end=end).samples[0][1].at, np.array([1e-6, 3e-6]) + shift)
    with pytest.raises(CaseError, match=facts(r"objective\.0\.begin = 1e-05 s: .* from -2e-06 s to 2\.1e-05 s")):
        objective(begin=1e-5, end=2e-5)


@pytest.mark.parametrize("changes, message", [
    ({"objective": []}, "objective: there is none"),
    ({"objective": [{**TRACE, "times": [1.0]}]}, r"objective\.0\.times: data from 1 s to 1 s, and the run lasts"),
    ({"objective": [{**TRACE, "units": {"slip": "Pa"}}]}, r"objective\.0\.units\.slip = 'Pa': .* of another kind"),
    ({"objective": [{**TRACE, "instrument": "falt"}]}, r"objective\.0\.instrument = 'falt': .*did you mean 'fault'"),
    ({"objective": [{**TRACE, "data": {"slep": [0.0]}, "units": {"slep": "m"}}]}, r"no such channel, did you mean"),
    ({"objective": [TRACE, {"kind": "slip_time", "position": 16e-3}]}, r"objective\.1.* is in s, and objective\.0"),
    ({"objective": SLIP, "unknowns": [{"key": "faults.main.friction.mu"}]}, r"unknowns\.0\.key .*did you mean"),
    ({"objective": SLIP, "stop_when": {"sliding_dead_for": 1e-6}}, "stop_when: the end of the run"),
    ({"objective": SLIP, "unknowns": [{"key": "faults.main.friction.mu_s"}] * 2}, "is given twice"),
    ({"objective": SLIP, "unknowns": [{"key": "materials.default.c_q"}]}, r"did you mean 'materials\.default\.c_"),
    ({"objective": SLIP, "unknowns": [{"key": "materials.default.c_p", "shape": "knots", "knots": [0.0, 1e-2]}]},
     "is one number"),
    ({"objective": SLIP, "unknowns": [{"key": "faults.main.friction.mu_s", "shape": "knots", "knots": [8.0, 9.0]}]},
     r"unknowns\.0\.knots = \[8\.0, 9\.0\]: the interface lies from .* place knots there"),
])  # fmt: skip
def test_what_cannot_be_differentiated_is_refused_before_the_first_step(
    changes: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a step was made")

    monkeypatch.setattr("ruptfx.stepping.steppers.leapfrog.LeapfrogMotion.step", refuse)
    case = parse_case(slip_weakening({"instruments": [FAULT], **changes}))
    with pytest.raises(RuptfxError, match=facts(message)):
        gradient(case, progress=False)


def test_a_law_whose_start_cannot_be_traced_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    cls = alternatives("ruptfx.laws.friction")["linear_slip_weakening"]
    monkeypatch.setattr(cls, "initial_state", lambda self, normal, shear, rate: {
        "cumulative_slip": np.array([0.0 if value > 0 else 1.0 for value in normal])})  # fmt: skip
    with pytest.raises(RuptfxError, match=r"numpy\.where\("):
        gradient(parse_case(slip_weakening(RUPTURE)), progress=False)


def test_an_unknown_that_the_objective_does_not_feel_is_named() -> None:
    """Cohesion that is lost has no effect; the others have one."""
    law = {"kind": "cohesion", "c": 1e5, "D_cohesion": 1e-6, "law": {"kind": "coulomb", "mu_d": 1e3}}
    case = parse_case(slip_weakening({**RUPTURE, "faults.main.friction": law}))
    with pytest.raises(
        RuptfxError, match=facts(r"does not depend on 'faults\.main\.friction\.c', its gradient is zero")
    ):
        gradient(case, unknowns=["faults.main.friction.c"], progress=False)


def test_a_step_beyond_the_memory_is_refused() -> None:
    with pytest.raises(RuptfxError, match=facts(r"history .* GB .* 1e-06 GB .*--memory")):
        gradient(parse_case(slip_weakening(RUPTURE)), progress=False, memory=1e3)


@pytest.mark.parametrize("segments, checkpoints", [(1, 1), (2, 1), (9, 1), (9, 3), (20, 4), (20, 20), (37, 2)])
def test_schedules_of_checkpoints_are_the_best_ones(segments: int, checkpoints: int) -> None:
    """The fewest segments by dynamic programming, which tries every place of the next checkpoint."""

    @cache
    def fewest(n: int, c: int) -> int:
        if c == 1 or n == 1:
            return n * (n - 1) // 2
        return min(first + fewest(n - first, c - 1) + fewest(first, c) for first in range(1, n))

    assert passed(segments, checkpoints) == fewest(segments, checkpoints)
    if segments > 1 and checkpoints > 1:
        first = split(segments, checkpoints)
        parts = fewest(segments - first, checkpoints - 1) + fewest(first, checkpoints)
        assert first + parts == fewest(segments, checkpoints)


def test_schedules_keep_to_the_memory() -> None:
    """One checkpoint is as large as the history of 30 steps."""
    before = 1000
    for most in (1001.0, 1000.0, 400.0, 250.0, 100.0, 20.0, 2.0):
        found = schedule(1000, 1.0, 30.0, most)
        assert found.memory <= most
        assert found.memory == found.stored * 30.0 + min(found.length + 1, 1001)
        assert found.forward_steps >= before
        before = found.forward_steps
    assert schedule(1000, 1.0, 30.0, 1001.0).forward_steps == 1000
    assert schedule(1000, 1.0, 30.0, 250.0).forward_steps < 2400
    assert "4 checkpoints" in schedule(1000, 1.0, 30.0, 250.0).text


COHESION = {"kind": "linear", "f_t": 1e6, "c": 1e6, "G_Ic": 10.0, "G_IIc": 10.0}
STRIKE_SLIP = {"objective": SLIP, "duration": 1e-6}


@pytest.mark.parametrize("table, parts", [
    (slip_weakening({**RUPTURE, "damping.kelvin_voigt": {"fraction": 0.2}, "plane": "strain", "instruments": [
        {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": [18e-3, 2e-3], "direction": [1.0, 0.0]}],
        "boundaries": [{"kind": "absorbing", "edge": "upper.top"},
                       {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": 0.1, "ramp": 1e-6}],
        "objective": [*SLIP, {"kind": "traces", "instrument": "body", "times": [6e-6], "data": {"velocity": [0.1]},
                              "units": {"velocity": "m/s"}, "sigma": 0.1}]}), (0.4, 0.12)),
    (strike_slip(STRIKE_SLIP), (0.3,)),
], ids=["plane", "solid"])  # fmt: skip
def test_gradients_in_less_memory_are_bitwise_the_same(table: dict[str, Any], parts: tuple[float, ...]) -> None:
    """From checkpoints or from the start of the run, whichever takes fewer steps; two sweeps backward, and others."""
    case = parse_case(table)
    whole = Objective(case, case.objective)
    kept = whole.sweeps.made.schedule
    assert kept is not None and kept.segments == 1
    expected = whole.gradient()
    change = [np.cos(np.arange(each.size)).reshape(each.shape) for each in whole.sweeps.parameters]
    readings = whole.sweeps.tangent(change)
    constant = [Unknown(key="materials.default.density")]
    by_density = whole.gradient(constant)[0].values
    for part in parts:
        made = Objective(case, case.objective, most=part * kept.memory)
        plan = made.sweeps.made.schedule
        assert plan is not None and plan.segments > 1 and plan.memory <= part * kept.memory
        assert made.value == whole.value
        for sweep in range(2):
            found = made.gradient()
            if sweep == 0:
                assert plan.forward_steps - plan.length < made.sweeps.made.steps_made <= plan.forward_steps
            for one, other in zip(expected, found, strict=True):
                np.testing.assert_array_equal(one.values, other.values)
        for one, other in zip(readings, made.sweeps.tangent(change), strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(made.gradient(constant)[0].values, by_density)
        assert any(np.any(each.values) for each in found)


@pytest.mark.parametrize("changes, key", [
    ({"faults.main.sliding": {}, "faults.main.contact": COMPLIANT}, "faults.main.sliding"),
    ({"stepper": {"kind": "hybrid"}, "faults.main.contact": COMPLIANT}, "stepper.kind = 'hybrid'"),
    ({"boundaries": [{"kind": "periodic", "first": "lower.left", "second": "lower.right"}]}, "boundaries.0"),
    ({"stages": [{"duration": 14e-6}]}, "stages"),
    ({"materials.default": {"kind": "maxwell", "young_modulus": 5e9, "poisson_ratio": 0.3, "density": 1200.0,
                            "relaxation_time": 1e-5}}, "materials.default.kind = 'maxwell'"),
    ({"attachments": [{"kind": "foundation", "name": "ground", "edge": "lower.bottom", "normal": 1e12,
                       "tangential": 1e12, "cohesion": COHESION}]}, "attachments"),
    ({"faults.main.cohesion": COHESION}, "cohesion"),
])  # fmt: skip
def test_a_case_with_an_objective_refuses_what_has_no_adjoint(changes: dict[str, Any], key: str) -> None:
    table = slip_weakening({**RUPTURE, **changes})
    with pytest.raises(CaseError, match=f"{re.escape(key)}.*adjoint"):
        parse_case(table)
    parse_case(merged(table, {"objective": None}))


def test_derivatives_by_knots_are_those_by_hats() -> None:
    """The value at a knot changes the points around it in proportion to their distances from its neighbours."""
    key, knots = "faults.main.initial_stress.shear", [4e-3, 9e-3, 20e-3]
    case = parse_case(slip_weakening(RUPTURE))
    field = gradient(case, unknowns=[key], progress=False)
    found = gradient(case, unknowns=[Unknown(key=key, shape="knots", knots=knots)], progress=False)
    by_points, by_knots = field[key], found[key]
    x = field["position_main"].values
    middle = np.interp(x, knots, [0.0, 1.0, 0.0])
    assert by_knots.shape == (3,) and by_knots.attrs["units"] == by_points.attrs["units"]
    np.testing.assert_array_equal(found[by_knots.dims[0]], knots)
    assert float(by_knots[1]) == pytest.approx(float(by_points.values @ middle), rel=1e-13)
    assert float(by_knots.sum()) == pytest.approx(by_points.attrs["uniform_change"], rel=1e-13)
    figure = draw(found)
    assert figure.axes[0].lines[-1].get_ydata() == pytest.approx(by_knots.values)


def test_values_between_knots_are_linear_and_constant_beyond() -> None:
    line: Any = SimpleNamespace(across=None)
    x = np.array([0.0, 1.0, 1.5, 3.0, 4.0, 9.0])
    found = hats(Unknown(key="key", shape="knots", knots=[1.0, 2.0, 4.0]), line, x, "key")
    expected = [[1, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0.5], [0, 0, 1], [0, 0, 1]]
    np.testing.assert_allclose(found, expected)


def test_the_command_writes_data_and_a_figure(tmp_path: Path) -> None:
    import xarray

    path = tmp_path / "case.toml"
    number = {"key": "faults.main.friction.D_c", "shape": "number"}
    field = {"key": "faults.main.initial_stress.shear"}
    path.write_text(tomli_w.dumps(slip_weakening({**RUPTURE, "unknowns": [number, field]})))
    assert launch.run_on(1, ["gradient", str(path), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    found = xarray.load_dataset(tmp_path / "out" / "gradient.nc", engine="h5netcdf")
    assert found[number["key"]].ndim == 0 and found[number["key"]].attrs["units"] == "1/m"
    shear = found[field["key"]]
    assert shear.dims == ("point_main",) and shear.attrs["units"] == "1/Pa"
    assert shear.attrs["uniform_change"] == pytest.approx(float(shear.sum()))
    assert (tmp_path / "out" / "gradient.png").stat().st_size > 5000
    assert (tmp_path / "out" / "case.toml").exists()
    assert found.attrs["forward_runs"] == 1 and "no checkpoints" in found.attrs["history"]


def test_differences_agree_where_there_are_no_kinks() -> None:
    """Ageing law, and an amplitude of nucleation; constants of bodies are left out."""
    keys = [f"faults.main.{key}" for key in ("friction.D_c", "friction.f_0", "nucleation.0.extra")]
    found = gradient(bench.rupture(), unknowns=[*keys, "materials.default.density"], progress=False, check=True)
    for key in keys:
        about = found[key].attrs
        assert about["by_differences"] == pytest.approx(about["uniform_change"], rel=1e-3), key
    assert "by_differences" not in found["materials.default.density"].attrs


@pytest.mark.slow
def test_differences_at_once_are_those_one_after_the_other() -> None:
    """By two cores and by one worker: bitwise, for a number of the law, a nucleation and a shift of the data."""
    pytest.importorskip("distributed")
    from distributed import LocalCluster

    keys = ["faults.main.friction.D_c", "faults.main.nucleation.0.extra", "objective.0.time_shift"]
    case = bench.rupture().changed("duration", 0.3)
    times = {"times": [0.1, 0.2], "data": {"velocity": [0.0, 0.1]}, "units": {"velocity": "m/s"}, "sigma": 0.3}
    case = case.changed("objective", [{"kind": "traces", "instrument": "body", **times},
                                      {"kind": "final_slip", "sigma": 1.0, "target": 0.3}])  # fmt: skip

    def compared(**at_once: Any) -> list[tuple[float, float]]:
        found = gradient(case, unknowns=keys, progress=False, check=True, **at_once)
        return [(found[key].attrs["by_differences"], found[key].attrs["difference_step"]) for key in keys]

    alone = compared()
    assert all(slope for slope, _ in alone)
    assert compared(cores=2) == alone
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        assert compared(scheduler=cluster.scheduler_address) == alone


def test_cores_without_a_comparison_are_refused() -> None:
    with pytest.raises(RuptfxError, match=facts("are for the runs of --check; add --check")):
        gradient(bench.rupture(), progress=False, cores=2)


def test_the_command_names_unknowns_near_kinks(tmp_path: Path) -> None:
    """With slip weakening points begin to slide a step earlier for 600 Pa more, and the objective has kinks."""
    from typer.testing import CliRunner

    from ruptfx.app.cli import app

    path = tmp_path / "case.toml"
    keys = ["faults.main.initial_stress.shear", "faults.main.friction.D_c"]
    table = slip_weakening({"duration": 12e-6, "faults.main.contact": SPLIT, "unknowns": [{"key": key} for key in keys],
                            **velocimeter([18e-3, 2e-3], [1.0, 0.0])})  # fmt: skip
    path.write_text(tomli_w.dumps(table))
    said = CliRunner().invoke(app, ["gradient", str(path), "--out", str(tmp_path / "out"), "--check"])
    assert said.exit_code == 0, said.output
    text = " ".join(said.output.split())
    assert "by differences" in text
    assert f"{keys[0]}: the gradient says" in text and f"{keys[1]}: the gradient says" not in text


def test_recorded_runs_are_those_of_the_time_loop(tmp_path: Path) -> None:
    """The objective of a run of `simulate` from its files."""
    from ruptfx import simulate

    case = parse_case(slip_weakening({**RUPTURE, "faults.main.contact": SPLIT}))
    made = Objective(case, case.objective)
    with simulate(case, out=tmp_path / "run", progress=False) as record:
        slip = record.interface["slip"].values[-1]
    np.testing.assert_array_equal(made.samples[0][1].values, slip)


STRESS = {"kind": "smooth_patch", "extra": 1e6, "center": 16e-3, "radius": 4e-3, "rise": 4e-6}
WEAKER = {"kind": "friction_drop", "mu_d": 0.1, "center": 16e-3, "half_width": 3e-3, "t_w": 3e-6}
PATCH = {"kind": "smooth_patch", "extra": 1e6, "center": {"x": 0.0, "y": 0.0, "z": -4e-3}, "radius": 3e-3, "rise": 1e-6}
SIGNAL = {"kind": "traces", "instrument": "fault", "sigma": 1e-6}
LINEAR = {
    "plane": slip_weakening({
        "duration": 9e-6, "faults.main.initial_stress.shear.inside": 3.2e6, "faults.main.nucleation": [WEAKER, STRESS],
        "instruments": [{"kind": "fault_receiver", "name": "fault", "interval": 2e-7, "position": 14e-3}],
        "objective": [{**SIGNAL, "times": [4e-6, 6e-6, 8e-6], "data": {"slip": [1e-6, 2e-6, 3e-6]},
                       "units": {"slip": "m"}}],
    }),
    "solid": strike_slip({
        "duration": 2e-6, "faults.main.nucleation": [PATCH], "faults.main.initial_stress.rake": 30.0,
        "instruments": [{"kind": "fault_receiver", "name": "fault", "interval": 2e-7, "point": [1e-3, 0.0, -3e-3]}],
        "objective": [{**SIGNAL, "times": [1e-6, 1.5e-6, 1.9e-6], "data": {"slip_1": [1e-6, 2e-6, 3e-6]},
                       "units": {"slip_1": "m"}}],
    }),
}  # fmt: skip


@pytest.mark.parametrize("name", LINEAR)
def test_tangent_linear_sweeps_are_those_of_the_adjoint_for_every_unknown(name: str) -> None:
    """The scalar product of residuals and the change of readings is that of the gradient and the change of a field."""
    case = parse_case(LINEAR[name])
    objective = Objective(case, case.objective)
    known = {key: place for key, place in places(objective.sweeps.model).items() if key.startswith("faults.")}
    assert any("nucleation" in key for key in known) and any("friction" in key for key in known)
    gradients = objective.gradient([Unknown(key=key) for key in known])
    position = objective.sweeps.points[0].fault.interface.position
    change = np.cos(300 * position) + 0.3 * np.sin(1700 * position)
    slopes = {}
    for (key, place), by in zip(known.items(), gradients, strict=True):
        if by.values.shape != change.shape:
            continue
        slopes[key] = float(by.values @ change)
        moved = objective.change([(place, change)])
        assert float(np.concatenate(objective._factors) @ moved) == pytest.approx(slopes[key], rel=1e-8), key
    assert sum(slope != 0 for slope in slopes.values()) > len(known) / 2


def test_a_gradient_by_a_nucleation_in_three_dimensions() -> None:
    """Central differences of the objective by the extra stress of a patch, which pushes along the rake."""
    case = parse_case({**LINEAR["solid"], "instruments": [], "objective": SLIP})
    (exact,) = Objective(case, case.objective).gradient([Unknown(key="faults.main.nucleation.0.extra")])
    model = Model(case).in_steps("explicit")
    change = np.ones(len(model.faults[0].interface.position))
    values = [Objective(case, case.objective, record=False, model=perturbed(model, {}, {(0, 0): sign * change})).value
              for sign in (1, -1)]  # fmt: skip
    assert float(exact.values @ change) == pytest.approx(0.5 * (values[0] - values[1]), rel=1e-3)


def test_derivatives_that_differ_by_more_than_a_percent_disagree() -> None:
    assert disagree(1.0, 1.02) and disagree(-2.0, 2.0) and not disagree(1.0, 1.009) and not disagree(0.0, 0.0)
