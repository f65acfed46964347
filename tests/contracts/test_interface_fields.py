"""Every pore pressure and temperature of the folders, by its own example, in every stepper: effect, restart, ranks."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import HERE, block
from helpers.crack_cases import faulted as broken
from helpers.small_cases import branched, case, march, merged, plates, slip_weakening, strike_slip
from helpers.strike_cases import faulted
from helpers.whole_runs import whole_and_resumed
from scipy.special import exp1

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.case import Case, parse_case
from ruptfx.input.fields import INTERFACE_FIELDS
from ruptfx.input.former_names import FormerName
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.faults.fields import Heating
from ruptfx.platform import fem, parallel
from ruptfx.results.record import Record
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
KINDS = [
    (field, kind) for field in ("pore_pressure", "temperature") for kind in alternatives(f"ruptfx.interfaces.{field}")
]
every_kind = pytest.mark.parametrize("field, kind", KINDS)
SLIDES = {
    "order": 2, "duration": 1e-5, "mesh.element_size": 2e-3,
    "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "faults.main.friction": {
        "kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6,
    },
    "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6},
}  # fmt: skip
PUSHED = [
    *({"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"),
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1e-6},
]
SLOW = {"duration": 50.0, "boundaries": PUSHED}
FAST = {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.4}, "faults.main.initial_stress.shear": 3e6}
STEPPERS: dict[str, dict[str, Any]] = {
    "leapfrog": FAST,
    "split": {**FAST, "faults.main.contact": {"kind": "split_node"}},
    "generalized_alpha": {**FAST, "stepper": {"kind": "generalized_alpha"}, "duration": 1e-4},
    "quasi_static": {**SLOW, "stepper": {"kind": "quasi_static", "radiation_damping": True}},
    "quasi_dynamic": {**SLOW, "stepper": {"kind": "quasi_dynamic"}},
    "hybrid": {**FAST, "stepper": {"kind": "hybrid"}},
}
FOLLOW_THE_STATE = ("dilatancy",)
"""Kinds that need a friction law with the state theta."""
every_stepper = pytest.mark.parametrize("stepper", STEPPERS)


def example(field: str, kind: str) -> dict[str, Any]:
    """What the kind gives as an example."""
    value: dict[str, Any] = tomllib.loads(f"x = {alternatives(f'ruptfx.interfaces.{field}')[kind].example}")["x"]
    return value


def with_field(field: str, kind: str, changes: dict[str, Any] | None = None) -> Case:
    changes = dict(changes or {})
    if kind in FOLLOW_THE_STATE:
        changes.pop("faults.main.friction", None)
    return parse_case(plates({**SLIDES, f"faults.main.{field}": example(field, kind), **changes}))


@every_kind
def test_written_and_read_again(field: str, kind: str) -> None:
    given = with_field(field, kind)
    again = parse_case(tomllib.loads(given.to_toml()))
    assert example(field, kind)["kind"] == kind and again == given and again.hash == given.hash


@every_kind
def test_contributions_add_to_declared_fields(field: str, kind: str) -> None:
    model = Model(with_field(field, kind))
    (made,) = model.faults[0].fields.contributions
    n = len(model.faults[0].interface.plus)
    assert field in made.adds and set(made.adds) <= set(INTERFACE_FIELDS)
    initial = model.faults[0].fields.initial()
    assert set(initial) == set(made.adds) and all(values.shape == (n,) for values in initial.values())
    assert all(values.ndim == 2 and len(values) == n for values in made.memory().values())


def rows(given: Case, comm: Any, steps: int) -> tuple[np.ndarray, list[float]]:
    """Fields of all points after some steps, in order, and time and energies."""
    model = Model(given, comm)
    motion, state = given.stepper.bind(model), model.initial_state()
    for _ in range(steps):
        motion.step(state)
    face, fields = model.faults[0].interface, state.faults["main"]
    names = ("slip", "shear_traction", *(name for name in INTERFACE_FIELDS if name in fields))
    own = np.column_stack([face.number, *(fields[name] for name in names)])[face.owned]
    table = parallel.share_rows(comm, own)
    return table[np.argsort(table[:, 0])], [state.time, *motion.energies(state).values()]


@every_kind
@every_stepper
def test_the_same_on_any_ranks(field: str, kind: str, stepper: str) -> None:
    given = with_field(field, kind, STEPPERS[stepper])
    for ours, theirs in zip(rows(given, COMM, 6), rows(given, fem.MPI.COMM_SELF, 6), strict=True):
        size = np.maximum(np.abs(theirs).max(axis=0), 1e-300)
        np.testing.assert_allclose(ours / size, theirs / size, atol=1e-7)


@pytest.mark.parametrize("stepper", STEPPERS)
def test_friction_is_that_of_the_effective_normal_stress(stepper: str) -> None:
    """A uniform pressure p and sigma + p slide as sigma alone, but for the traction on the bodies."""
    changes = {**STEPPERS[stepper], "faults.main.initial_stress.normal": 8e6}
    wet = case({**SLIDES, **changes, "faults.main.pore_pressure": {"kind": "given", "pressure": 2e6}})
    dry = case({**SLIDES, **changes, "faults.main.initial_stress.normal": 6e6})
    ours, theirs = (rows(each, fem.MPI.COMM_SELF, 8)[0] for each in (wet, dry))
    assert np.abs(theirs[:, 1]).max() > 0
    np.testing.assert_allclose(ours[:, 1:3], theirs[:, 1:3], rtol=1e-6, atol=1e-9 * np.abs(theirs[:, 1]).max())
    assert np.all(ours[:, 3] == 2e6)


@pytest.mark.parametrize("stepper", ["leapfrog", "split", "generalized_alpha", "quasi_static"])
def test_heat_is_the_work_of_friction(stepper: str) -> None:
    """At every point, less what radiates.

    Split nodes have worked until half a step after the tractions, and from rest in half a step before the first slip.
    """
    given = with_field("pore_pressure", "thermal_pressurisation", STEPPERS[stepper])
    model = Model(given, fem.MPI.COMM_SELF)
    motion, state = given.stepper.bind(model), model.initial_state()
    fields, area = state.faults["main"], model.faults[0].interface.area
    motion.step(state)
    first = 0.25 * state.lag * fields["shear_traction"] * fields["mean_slip_rate"]
    for _ in range(9):
        motion.step(state)
    if stepper == "quasi_static":
        energy = motion.energies(state)
        assert area @ fields["frictional_heat"] == pytest.approx(energy["frictional_dissipation"], rel=1e-6)
    else:
        late = 0.5 * state.lag * fields["shear_traction"] * fields["mean_slip_rate"]
        beyond = late - first if stepper == "split" else 0.0
        np.testing.assert_allclose(fields["frictional_heat"], fields["friction_work"] - beyond, rtol=1e-12)
    assert fields["frictional_heat"].min() > 0


SHORT = {"leapfrog": 3e-6, "generalized_alpha": 3e-5, "quasi_dynamic": 0.2}


@every_kind
@pytest.mark.parametrize("stepper", SHORT)
def test_recorded_and_resumed_bitwise(field: str, kind: str, stepper: str, shared_tmp_path: Path) -> None:
    changes = {**STEPPERS[stepper], "duration": SHORT[stepper]}
    plain = with_field(field, kind, changes)
    motion, state = plain.stepper.bind(Model(plain)), Model(plain).initial_state()
    while state.time < 0.6 * plain.duration:
        motion.step(state)
    given = with_field(field, kind, {**changes, "output.checkpoint_steps": state.step})
    whole, cut = whole_and_resumed(given, shared_tmp_path / f"{field}_{kind}_{stepper}")
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            for name in Model(given, fem.MPI.COMM_SELF).faults[0].fields.initial():
                values = one.interface[name]
                assert values.attrs["units"] == INTERFACE_FIELDS[name].unit
                assert INTERFACE_FIELDS[name].long_name in values.attrs["long_name"]
            # On several ranks the direct solver rounds the displacement of the bodies differently in every run.
            rounds = COMM.size > 1 and stepper == "quasi_dynamic"
            for name in one.interface:
                ours, theirs = (np.asarray(each.interface[name]) for each in (one, other))
                slack = 1e-12 * np.abs(ours).max() if rounds and name == "displacement_jump" else 0.0
                np.testing.assert_allclose(ours, theirs, rtol=0, atol=slack, err_msg=name)


@every_kind
def test_surfaces_have_fields(field: str, kind: str) -> None:
    law = {"faults.main.friction": SLIDES["faults.main.friction"]} if kind in FOLLOW_THE_STATE else {}
    model, _, state = march(parse_case(strike_slip({
        "duration": 2e-7, "faults.main.initial_stress.normal": 6e6, f"faults.main.{field}": example(field, kind), **law,
    })))  # fmt: skip
    fields = state.faults["main"]
    assert all(np.isfinite(fields[name]).all() for name in model.faults[0].fields.initial())


def test_one_number_is_a_line_of_wells_across_a_surface() -> None:
    """The fluid of all its points is that of the well, and the pressure is the same at all depths."""
    wells = [{"center": 0.0, "rate": 1e-9}]
    model, _, state = march(parse_case(strike_slip({
        "duration": 1e-6, "faults.main.initial_stress.normal": 6e6,
        "faults.main.pore_pressure": {**WELL, "wells": wells},
    })))  # fmt: skip
    face, pressure = model.faults[0].interface, state.faults["main"]["pore_pressure"]
    along = np.round(face.locations[:, 0], 9)
    spread = max(np.ptp(pressure[along == x]) for x in np.unique(along))
    assert pressure.max() > 0 and spread < 1e-9 * pressure.max()
    stored = parallel.total(COMM, float((face.owned * face.area) @ pressure))
    storage = WELL["compressibility"] * WELL["porosity"] * WELL["thickness"]
    assert storage * stored == pytest.approx(1e-9 * state.time, rel=1e-9)


def test_contributions_add_up() -> None:
    both = [{"kind": "given", "pressure": 1e6}, {"kind": "given", "pressure": 5e5}]
    model = Model(case({**SLIDES, "faults.main.pore_pressure": both}))
    assert np.all(model.faults[0].fields.initial()["pore_pressure"] == 1.5e6)


def test_a_history_is_followed_within_steps() -> None:
    history = {"kind": "sampled", "times": [0.0, 1e-5], "values": [0.0, 1.0]}
    given = with_field("pore_pressure", "given", {
        **FAST, "faults.main.pore_pressure": {"kind": "given", "pressure": 1e6, "history": history}})  # fmt: skip
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    for _ in range(7):
        motion.step(state)
    expected = 1e6 * state.fault_time / 1e-5
    np.testing.assert_allclose(state.faults["main"]["pore_pressure"], expected, rtol=1e-12)
    strength = 0.4 * (state.faults["main"]["normal_stress"] - expected)
    np.testing.assert_allclose(state.faults["main"]["shear_traction"], strength, rtol=1e-12)


def test_pressure_above_the_normal_stress_ends_the_run_with_its_place() -> None:
    history = {"kind": "sampled", "times": [0.0, 1e-6], "values": [0.0, 1.0]}
    rising = {"kind": "given", "pressure": 7e6, "history": history}
    given = case({**SLIDES, **FAST, "faults.main.pore_pressure": rising})
    with pytest.raises(RuptfxError, match=facts(r"faults\.main\.pore_pressure: .* 6e\+06 Pa")):
        march(given)


def test_a_rupture_with_thermal_pressurisation_is_weaker() -> None:
    wet = {"kind": "thermal_pressurisation", "heat_capacity": 2.7e6, "thermal_diffusivity": 1e-6,
           "hydraulic_diffusivity": 1e-6, "pressure_per_temperature": 1e6, "width": 1e-6}  # fmt: skip
    changes = {"order": 2, "duration": 8e-6}
    slips = [np.abs(march(parse_case(merged(slip_weakening(changes), more)))[2].faults["main"]["slip"]).max()
             for more in ({}, {"faults.main.pore_pressure": wet})]  # fmt: skip
    assert slips[1] > 1.02 * slips[0]


WELL = {**example("pore_pressure", "diffusion")}
TP = example("pore_pressure", "thermal_pressurisation")
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "negative diffusivity": ({"faults.main.pore_pressure": {**TP, "hydraulic_diffusivity": -1e-6}},
                             r"pore_pressure.*hydraulic_diffusivity = -1e-06.* greater than 0"),
    "missing heat capacity": ({"faults.main.pore_pressure": {k: v for k, v in TP.items() if k != "heat_capacity"}},
                              r"pore_pressure.*heat_capacity"),
    "pressure above the normal stress": ({"faults.main.pore_pressure": {"kind": "given", "pressure": 7e6}},
                                         r"pore_pressure: 7e\+06 Pa .* 6e\+06 Pa .* reduce the pressure"),
    "well off the fault": ({"faults.main.pore_pressure": {**WELL, "wells": [{"center": 1.0, "rate": 1e-6}]}},
                           r"faults\.main\.pore_pressure\.0\.wells\.0\.center = 1 m: .* from 0 to 0\.012 m"),
    "two quantities of a well": ({"faults.main.pore_pressure": {**WELL, "wells": [{"center": 0.0}]}},
                                 r"rate, pressure: give one of them"),
    "no source": ({"faults.main.pore_pressure": {"kind": "given"}}, r"pressure, file: give one of them"),
    "fracture": ({"faults.main.temperature": {"kind": "given", "temperature": 300.0}, "faults.main.sliding": {}},
                 r"faults\.main\.temperature.*remove faults\.main\.temperature, or remove faults\.main\.sliding"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_bad_input_is_refused_with_key_and_remedy(what: str) -> None:
    changes, message = REFUSED[what]
    with pytest.raises(CaseError, match=facts(message)):
        Model(case({**SLIDES, **changes}))


def test_a_pumping_record_is_a_rate_and_its_history(tmp_path: Path) -> None:
    """60 L/min are 1e-3 m3/s, a day is 86400 s."""
    (tmp_path / "pump.csv").write_text("time (d), rate (L/min)\n0, 0\n1, 60\n2, 30\n")
    table = plates({**SLIDES, "faults.main.pore_pressure": {**WELL, "wells": [{"center": 0.0, "file": "pump.csv"}]}})
    (well,) = parse_case(table, tmp_path).faults["main"].pore_pressure[0].wells
    assert well.history.times == [0.0, 86400.0, 172800.0]
    assert [well.rate * value for value in well.history.values] == pytest.approx([0.0, 1e-3, 0.5e-3])


def test_what_a_well_injects_is_stored(tmp_path: Path) -> None:
    """In a layer without flow through its rim, to rounding, and evenly after a long time: p = Q t / (beta phi b L)."""
    model = Model(case({**SLIDES, "faults.main.pore_pressure": {**WELL, "rim": "no_flux"}}))
    face = model.faults[0].interface
    (made,) = model.faults[0].fields.contributions
    memory, none = made.memory(), np.zeros(len(face.plus))
    for number in range(50):
        made.plan(memory, number * 1e-3, 1e-3)
        made.advance(memory, number * 1e-3, Heating(none, none, 1e-3))
    pressure = made.values(memory, 0.05, Heating(none, none, 0.0))["pore_pressure"]
    assert made.along.mass[face.number] @ pressure == pytest.approx(1.25e-6 * 0.05, rel=1e-10)
    np.testing.assert_allclose(pressure, 1.25e-6 * 0.05 / (1e-9 * 12e-3), rtol=0.05)


def test_a_file_of_pressure_is_interpolated_in_time_and_place(tmp_path: Path) -> None:
    lines = [f"{time}, {place}, {1e6 * time * place}" for time in (0.0, 2.0) for place in (-1.0, 1.0)]
    (tmp_path / "p.csv").write_text("time (s), position (m), pressure (Pa)\n" + "\n".join(lines) + "\n")
    table = plates({**SLIDES, "faults.main.pore_pressure": {"kind": "given", "file": "p.csv"}})
    model = Model(parse_case(table, tmp_path))
    fields, x = model.faults[0].fields, model.faults[0].interface.position
    none = np.zeros(len(x))
    values = fields.values(fields.memory(none), 0.25, Heating(none, none, 0.25))["pore_pressure"]
    np.testing.assert_allclose(values, 1e6 * 0.5 * x, atol=1e-6)


def test_friction_reads_the_temperature_of_its_interface() -> None:
    """With a(T) in proportion to T, doubling T doubles the change of the strength with ln V."""
    law = {"kind": "rate_and_state_thermal", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6, "T_0": 300.0,
           "temperature_initial": 300.0, "a_slope": 1.0}  # fmt: skip
    slopes = []
    for temperature in (300.0, 600.0):
        heated = {"faults.main.friction": law, "faults.main.temperature": {"kind": "given", "temperature": temperature}}
        fault = Model(case({**SLIDES, **heated})).faults[0]
        state = {name: fault.initial_state()[name] for name in fault.friction.all_state_fields()}
        sigma = np.full(len(fault.normal_stress_0), 1e6)
        low, high = (fault.friction.strength(rate, sigma, state) for rate in (1e-3, 1e-3 * np.e))
        slopes.append(high - low)
    np.testing.assert_allclose(slopes[1], 2 * slopes[0], rtol=1e-6)


@pytest.mark.parametrize("order", [4, 5])
def test_a_well_in_a_surface_is_that_of_theis(order: int) -> None:
    """A Gaussian source of standard deviation w: p = Q / (4 pi T) [E1(r^2 / (2 w^2 + 4 a t)) - E1(r^2 / (2 w^2))]."""
    width, alpha = 0.6e-3, 0.1  # m2/s: k / (eta beta phi) of the example
    duration = 0.25e-6 / (2 * alpha)
    well = {"center": {"x": 0.0, "y": 0.0, "z": -4e-3}, "rate": 1e-9, "half_width": width}
    model = Model(parse_case(strike_slip({
        "order": order, "faults.main.pore_pressure": {**WELL, "wells": [well]}})), fem.MPI.COMM_SELF)  # fmt: skip
    face = model.faults[0].interface
    (made,) = model.faults[0].fields.contributions
    memory, none, steps = made.memory(), np.zeros(len(face.plus)), 40
    for number in range(steps):
        made.plan(memory, number * duration / steps, duration / steps)
        made.advance(memory, number * duration / steps, Heating(none, none, duration / steps))
    pressure = made.values(memory, duration, Heating(none, none, 0.0))["pore_pressure"]
    square = np.sum((face.locations - [0.0, 4e-3]) ** 2, axis=1)
    late = exp1(np.maximum(square, 1e-16) / (2 * width**2 + 4 * alpha * duration))
    expected = 1e-9 / (4 * np.pi * 1e-13 / 1e-3) * (late - exp1(np.maximum(square, 1e-16) / (2 * width**2)))
    np.testing.assert_allclose(pressure, expected, rtol=0, atol=1e-3 * expected.max())


@pytest.mark.parametrize("stepper", ["leapfrog", "split", "generalized_alpha"])
def test_the_former_law_of_a_fluid_is_a_known_pressure(stepper: str) -> None:
    """The same steps as with the nucleation that weakens the same law by the same pressure at all points."""
    duration = SHORT.get(stepper, SHORT["leapfrog"])
    begin, rise = 0.2 * duration, 0.3 * duration
    changes = {**STEPPERS[stepper], "duration": 2 * duration}
    law = changes["faults.main.friction"]
    drop = {"kind": "normal_stress_drop", "center": 0.0, "half_width": 1.0, "drop": 2e6, "begin": begin, "rise": rise,
            "duration": duration}  # fmt: skip
    former = {"kind": "pressurised", "pressure": 2e6, "begin": begin, "end": begin + duration, "rise": rise, "law": law}
    with pytest.warns(FormerName, match=facts("'pressurised'")):
        wet = case({**SLIDES, **changes, "faults.main.friction": former})
    assert wet.faults["main"].friction.kind() == "coulomb" and wet.faults["main"].pore_pressure[0].pressure == 2e6
    weak = case({**SLIDES, **changes, "faults.main.nucleation": drop})
    ours, theirs = (rows(each, fem.MPI.COMM_SELF, 10) for each in (wet, weak))
    assert np.abs(theirs[0][:, 1]).max() > 0
    np.testing.assert_allclose(ours[0][:, 1:3], theirs[0][:, 1:3], rtol=1e-9)
    np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-9)


PRESSED = {"kind": "pressurised", "pressure": 2e6, "begin": 1e-6, "end": 5e-6, "rise": 1e-6,
           "law": {"kind": "coulomb", "mu_d": 0.4}}  # fmt: skip
INSIDE = {"kind": "prakash_clifton", "L_p": 4e-5, "law": PRESSED}
FORMER: dict[str, dict[str, Any]] = {
    "inside a law": plates({"faults.main.friction": INSIDE}),
    "finite sliding": plates({
        "faults.main.friction": PRESSED, "faults.main.sliding": {},
        "faults.main.contact": SLIDES["faults.main.contact"]}),
    "on facets": block({"fracture.default.friction": PRESSED}),
    "beside facets": broken({"faults.main.friction": PRESSED}),
}  # fmt: skip


@pytest.mark.parametrize("place", FORMER)
def test_the_former_law_of_a_fluid_acts_as_before_where_interfaces_have_no_pressure(place: str) -> None:
    """0.4 (6 - 2) MPa at its full pressure, 0.4 (6 - 1) MPa halfway up, 0.4 6 MPa before and after."""
    with pytest.warns(FormerName, match=facts("'pressurised'")):
        read: Any = parse_case(FORMER[place], HERE)
    if place == "on facets":
        law = read.fracture.default.friction
    else:
        assert not read.faults["main"].pore_pressure
        law = read.faults["main"].friction
    inner = law.law if place == "inside a law" else law
    assert inner.kind() == "pressurised"
    clock, one = np.array([0.5e-6, 1.5e-6, 3e-6, 7e-6]), np.ones(4)
    strength = inner.strength(one, 6e6 * one, {"clock": clock})
    np.testing.assert_allclose(strength, 0.4e6 * np.array([6.0, 5.0, 4.0, 6.0]), rtol=1e-12)


@pytest.mark.filterwarnings("ignore::ruptfx.input.former_names.FormerName")
def test_a_slider_refuses_the_former_law_of_a_fluid_with_a_remedy() -> None:
    slider = {"kind": "spring_slider", "friction": PRESSED}
    with pytest.raises(CaseError, match=facts("friction.kind = 'pressurised': use rate_and_state_ageing")):
        parse_case(slider)
    assert parse_case({**slider, "friction": SLIDES["faults.main.friction"]}).kind() == "spring_slider"


@pytest.mark.filterwarnings("ignore::ruptfx.input.former_names.FormerName")
def test_the_former_law_of_a_fluid_inside_another_law_weakens_in_steps() -> None:
    _, _, state = march(case({**SLIDES, **FAST, "faults.main.friction": {
        **INSIDE, "law": {**PRESSED, "end": 1e-3}}}))  # fmt: skip
    fields = state.faults["main"]
    np.testing.assert_allclose(fields["clock"], state.fault_time, rtol=1e-12)
    sliding = fields["slip_rate"] > 0
    assert sliding.any() and fields["shear_traction"][sliding].max() < 0.4 * 4.1e6


def test_a_known_pressure_begins_and_ends_at_times_that_vary() -> None:
    """From x / (1 m/s) on it rises within 2 s, and falls from 10 s on."""
    begin = {"kind": "cone", "center": 0.0, "tip": 0.0, "slope": 1.0}
    pressure = {"kind": "given", "pressure": 1e6, "begin": begin, "end": 10.0, "rise": 2.0}
    fault = Model(case({**SLIDES, "faults.main.pore_pressure": pressure})).faults[0]
    none, x = np.zeros(len(fault.interface.plus)), fault.interface.position
    for time, expected in ((0.0, 0 * x), (1.0, 5e5 * np.clip(1.0 - x, 0, 2)), (11.0, 5e5 + 0 * x), (12.0, 0 * x)):
        values = fault.fields.values(fault.fields.memory(none), time, Heating(none, none, 0.0))["pore_pressure"]
        np.testing.assert_allclose(values, expected, atol=1e-6)


@pytest.mark.parametrize("permeability", [1e-13, {"kind": "along_dip", "profile": {
    "kind": "table", "positions": [0.0, 8.0], "values": [1e-13, 1e-13]}}])  # fmt: skip
def test_a_well_in_a_section_that_repeats_along_strike_is_that_of_theis(permeability: Any) -> None:
    """Half of a Gaussian source at the surface; nothing flows beyond the ends of the fault, and all of it is stored."""
    width, alpha, duration = 0.8, 0.1, 2.0
    wells = [{"center": {"x": 0.0, "y": 0.0, "z": 0.0}, "rate": 0.5e-9, "half_width": width}]
    fluid = {**WELL, "permeability": permeability, "wells": wells}
    model = Model(faulted({
        "mesh.fault_depth": 8.0, "mesh.depth": 12.0, "mesh.element_size": 0.5,
        "mesh.along_strike": {"length": 15.0, "period": 20.0, "points": 80}, "faults.main.pore_pressure": fluid,
    }), fem.MPI.COMM_SELF)  # fmt: skip
    face, (made,) = model.faults[0].interface, model.faults[0].fields.contributions
    memory, none, steps = made.memory(), np.zeros(len(face.plus)), 40
    for number in range(steps):
        made.plan(memory, number * duration / steps, duration / steps)
        made.advance(memory, number * duration / steps, Heating(none, none, duration / steps))
    pressure = made.values(memory, duration, Heating(none, none, 0.0))["pore_pressure"]
    square = np.maximum(np.sum(face.locations**2, axis=1), 1e-16)
    late = exp1(square / (2 * width**2 + 4 * alpha * duration))
    expected = 1e-9 / (4 * np.pi * 1e-13 / 1e-3) * (late - exp1(square / (2 * width**2)))
    np.testing.assert_allclose(pressure, expected, rtol=0, atol=3e-3 * expected.max())
    assert made.along.mass[face.number] @ pressure == pytest.approx(0.5e-9 * duration, rel=1e-10)
    assert np.all(pressure[np.abs(face.position) > 7.6] == 0)


def test_faults_that_meet_exchange_no_fluid_and_are_refused_with_a_remedy() -> None:
    """The branch begins on the main fault; with a known pressure there, or none, the case is accepted."""
    layer = {**WELL, "wells": []}
    pressed = {f"faults.{name}.initial_stress.normal": 6e6 for name in ("main", "branch")}
    both = {**pressed, "faults.main.pore_pressure": layer, "faults.branch.pore_pressure": layer}
    with pytest.raises(
        CaseError, match=facts(r"faults\.branch\.pore_pressure: meets faults\.main at .* use kind = 'given'.*remove")
    ):
        Model(parse_case(branched(both)))
    for changes in (
        {"faults.branch.pore_pressure": {"kind": "given", "pressure": 1e5}},
        {"faults.branch.pore_pressure": []},
    ):
        model = Model(parse_case(branched({**both, **changes})))
        assert [fault.name for fault in model.faults if any(each.flows for each in fault.fields.contributions)] == [
            "main"
        ]
