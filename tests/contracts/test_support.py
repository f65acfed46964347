"""What does not work together is refused by key, and every remedy that a refusal names is accepted by the same case."""

from __future__ import annotations

import copy
import re
import tomllib
from itertools import product
from typing import Any, get_args

import numpy as np
import pytest
from helpers.crack_cases import HERE, faulted
from helpers.crack_cases import block as torn_block
from helpers.messages import facts, facts_of
from helpers.sliding_cases import solids
from helpers.small_cases import COMPLIANT, HOMALITE, SPLIT, merged, plates, required, strike_slip
from typer.testing import CliRunner

from ruptfx.app.check_law.examples import table, tables
from ruptfx.app.cli import app
from ruptfx.app.reference.support_table import columns, features, judge
from ruptfx.case import parse_case
from ruptfx.case.support import Change, UnsupportedError, refusals_of, remedies
from ruptfx.input.schema import Alternative, CaseError, alternatives, package_of, set_key
from ruptfx.interfaces.sliding import Sliding
from ruptfx.laws.contact import ContactMethod
from ruptfx.laws.materials import Plane

pytest.importorskip("dolfinx")

from ruptfx.run import stages
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

STEPPERS, METHODS = alternatives("ruptfx.stepping.steppers"), alternatives("ruptfx.laws.contact")
STEPS = {kind: {"kind": kind, **required(kind)} for kind in STEPPERS}
AGEING = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6}
BOND = {"kind": "linear", "f_t": 1e6, "c": 2e6, "G_Ic": 10.0, "G_IIc": 20.0}
SIDES = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("lower", "upper")]
PUSH = {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 1.0}
STEADY = {"kind": "driven", "edge": "rock.bottom", "component": "x", "velocity": 0.0}


def block(changes: dict[str, Any]) -> dict[str, Any]:
    """Return the block that is torn apart, with a support along x, which steps without inertia need."""
    return torn_block({"boundaries": [*torn_block()["boundaries"], STEADY]} | changes)


ABSORBS = {"kind": "absorbing", "edge": "upper.left"}
SMALL = {
    "order": 1, "duration": 2e-6, "mesh": {"kind": "two_plates", "length": 4e-3, "height": 2e-3, "element_size": 1e-3},
    "boundaries": [{**PUSH, "edge": "lower.bottom", "velocity": 0.0},
                   {**PUSH, "edge": "lower.bottom", "component": "y", "velocity": 0.0}, PUSH],
    "faults.main.friction": AGEING, "faults.main.initial_stress": {"normal": 6e6, "shear": 3e6},
}  # fmt: skip
WATER = {"kind": "given", "pressure": 1e6}
HEATED = {"kind": "thermal_pressurisation", "heat_capacity": 2.7e6, "thermal_diffusivity": 1e-6,
          "hydraulic_diffusivity": 4e-4, "pressure_per_temperature": 0.1e6, "width": 20e-3}  # fmt: skip
FEATURES: dict[str, dict[str, Any]] = {
    "plain": {},
    "sliding": {"faults.main.sliding": {}},
    "cohesion": {"faults.main.cohesion": BOND},
    "sliding and cohesion": {"faults.main.sliding": {}, "faults.main.cohesion": BOND},
    "gap": {"faults.main.gap": 1e-6, "faults.main.initial_stress": {"normal": 0.0},
            "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}},
    "sliding and gap": {"faults.main.sliding": {}, "faults.main.gap": 1e-6,
                        "faults.main.initial_stress": {"normal": 0.0}},
    "periodic": {"boundaries": [*SIDES, *SMALL["boundaries"][:2]]},
    "stages": {"stages": [{"duration": 1e-6}, {"duration": 1e-6, "damping": {"mass": 1e3}}]},
    "objective": {"objective": [{"kind": "final_slip", "sigma": 1e-6}]},
    "objective and sliding": {"objective": [{"kind": "final_slip", "sigma": 1e-6}], "faults.main.sliding": {}},
    "objective and periodic": {"objective": [{"kind": "final_slip", "sigma": 1e-6}],
                               "boundaries": [*SIDES, *SMALL["boundaries"][:2]]},
    "objective and cohesion": {"objective": [{"kind": "final_slip", "sigma": 1e-6}], "faults.main.cohesion": BOND,
                               "stages": [{"duration": 1e-6}, {"duration": 1e-6}]},
    "pore pressure": {"faults.main.pore_pressure": WATER},
    "temperature": {"faults.main.temperature": {"kind": "given", "temperature": 300.0}},
    "pore pressure and sliding": {"faults.main.pore_pressure": WATER, "faults.main.sliding": {}},
    "objective and pore pressure": {"objective": [{"kind": "final_slip", "sigma": 1e-6}],
                                    "faults.main.pore_pressure": HEATED},
    "coulomb": {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.6}},
    "weakened": {"faults.main.nucleation": [{"kind": "friction_drop", "mu_d": 0.1, "center": 2e-3,
                                             "half_width": 1e-3}]},
    "single": {"precision": "single"},
    "single and sliding": {"precision": "single", "faults.main.sliding": {}},
    "single and objective": {"precision": "single", "objective": [{"kind": "final_slip", "sigma": 1e-6}]},
    "waves": {"damping": {"mass": 1e3, "kelvin_voigt": {}}, "boundaries": [*SMALL["boundaries"], ABSORBS]},
}  # fmt: skip
OF_CRACKS: dict[str, dict[str, Any]] = {
    "plain": {},
    "turning": {"large_rotations": True},
    "single": {"precision": "single"},
    "meeting": {"large_rotations": True, "collisions": {"kind": "potential"}},
    "stages": {"stages": [{"duration": 4e-6}, {"duration": 6e-6}]},
    "tied": {"boundaries": [{"kind": "periodic", "first": "rock.left", "second": "rock.right"}]},
}
CELLS: list[tuple[str, dict[str, Any]]] = [
    (f"{method}, {stepper}, {feature}", plates({
        **SMALL, "faults.main.contact": {"kind": method, **table(METHODS[method])}, "stepper": STEPS[stepper],
        **changes,
    })) for method, stepper, (feature, changes) in product(METHODS, STEPPERS, FEATURES.items())
] + [
    (f"{kind}, {stepper}, {feature}", block({"fracture.kind": kind, "stepper": STEPS[stepper], **changes}))
    for kind, stepper, (feature, changes) in product(alternatives(package_of("cracks")), STEPPERS, OF_CRACKS.items())
] + [
    (f"{kind} beside {method}", faulted({
        "fracture.kind": kind, "faults.main.contact": {"kind": method, **table(METHODS[method])},
    })) for kind, method in product(alternatives("ruptfx.interfaces.cracks"), METHODS)
]  # fmt: skip


def applied(given: dict[str, Any], changes: tuple[Change, ...]) -> dict[str, Any]:
    """The tables of a case with a remedy."""
    result = copy.deepcopy(given)
    gone = {key for change in changes if change.cls is None for key in change.keys}
    for change in changes:
        for key in change.keys if change.cls else ():
            old = given
            for name in key.split("."):
                old = old[name]
            contract = next(base for base in change.cls.__mro__ if Alternative in base.__bases__)
            own = {name for name, field in change.cls.model_fields.items() if field.is_required()}
            needed = {} if own <= contract.model_fields.keys() else table(change.cls)
            kept = {name: value for name, value in old.items() if name in contract.model_fields}
            # Where yield or damage depends on it, it is required although it has a default.
            stress = {"initial_stress": [-1.0] * 3 + [0.0] * 3} if "initial_stress" in change.cls.model_fields else {}
            needed = {name: needed[name] for name in own - kept.keys()}
            set_key(result, key, {"kind": change.kind, **needed, **stress, **kept})
    for key in sorted(gone, reverse=True):  # of lists the last entry first
        *parents, last = key.split(".")
        node: Any = result
        for name in parents:
            node = node[int(name)] if isinstance(node, list) else node[name]
        del node[int(last) if isinstance(node, list) else last]
    return result


def count_tried(cells: list[tuple[str, dict[str, Any]]], bound: int | None = None) -> tuple[int, int]:
    """Apply every remedy of the cells that are refused, and make a model with the first ones of each, or with all.

    Return the number of refused cells and that of remedies.
    """
    refused, tried, works = 0, 0, set()
    for name, given in cells:
        try:
            parse_case(given, HERE)
        except UnsupportedError as error:
            refused += 1
            assert error.remedies, f"{name}: {error}"
            words = str(error).partition("; use ")[2]
            assert set(re.findall(r"'(\w+)'", words)) == {
                change.kind for changes in error.remedies for change in changes if change.kind
            }, f"{name}: {error}"
            for number, changes in enumerate(error.remedies):
                case = parse_case(applied(given, changes), HERE)
                tried += 1
                if case.hash not in works and (bound is None or number < bound):
                    stages.bind(Model(case))
                    works.add(case.hash)
    return refused, tried


@pytest.mark.slow
def test_every_remedy_is_accepted() -> None:
    """In every cell of contact or way to break, stepper and feature; once in each of the cases that come out."""
    refused, tried = count_tried(CELLS, bound=1)
    assert refused > 100 and tried > 300


def test_every_remedy_about_pore_pressure_and_temperature_is_accepted() -> None:
    """Of all rows of both fields: sliding, objective and fracture; a model is made with every remedy."""
    fields = {"pore_pressure": HEATED, "temperature": {"kind": "given", "temperature": 300.0}}
    beside: dict[str, dict[str, Any]] = {
        "sliding": {"faults.main.sliding": {}}, "objective": {"objective": [{"kind": "final_slip", "sigma": 1e-6}]},
    }  # fmt: skip
    cells = [
        (
            f"{field}, {feature}",
            plates({**SMALL, "faults.main.contact": COMPLIANT, **changes, f"faults.main.{field}": own}),
        )
        for (field, own), (feature, changes) in product(fields.items(), beside.items())
    ] + [(f"{field}, fracture", faulted({f"faults.main.{field}": own})) for field, own in fields.items()]
    assert count_tried(cells) == (6, 12)


def test_every_remedy_about_attachments_and_materials_is_accepted() -> None:
    """Attachments in every stepper; materials in every stepper, with fracture, rotations, sliding, in every plane."""
    beside = {"faults.main.contact": COMPLIANT, "operator": "ufl_form"}
    attached = [
        (f"{kind}, {stepper}, {feature}", plates({**SMALL, **beside, "attachments": [example(cls)], **changes,
                                                  "stepper": STEPS[stepper]}))
        for (kind, cls), stepper, (feature, changes) in product(
            alternatives("ruptfx.interfaces.attachments").items(), STEPPERS,
            {"plain": {}, "sliding": {"faults.main.sliding": {}}}.items())
    ]  # fmt: skip
    made = {kind: merged({"kind": kind, **tables(cls, 1, lambda table: None)[0]}, {"fringe_constant": None})
            for kind, cls in alternatives("ruptfx.laws.materials").items()}  # fmt: skip
    materials = [
        *((f"{kind}, {stepper}", plates({**SMALL, **beside, "plane": "strain", "materials": {"default": given},
                                         "stepper": STEPS[stepper]}))
          for (kind, given), stepper in product(made.items(), STEPPERS)),
        *((f"{kind}, {plane}", plates({**SMALL, **beside, "plane": plane, "boundaries": [],
                                       "materials": {"default": given}}))
          for (kind, given), plane in product(made.items(), ("stress", "strain", "antiplane"))),
        *((f"{kind} with {way}", block({"fracture.kind": way, "operator": "ufl_form", "materials": {"default": given}}))
          for (kind, given), way in product(made.items(), alternatives(package_of("cracks")))),
        *((f"{kind}, sliding in quasi-static steps", plates({
            **SMALL, **beside, "plane": "strain", "faults.main.sliding": {}, "materials": {"default": given},
            "stepper": STEPS["quasi_static"]})) for kind, given in made.items()),
    ]  # fmt: skip
    refused, tried = count_tried(attached + materials, bound=1)
    assert refused > 25 and tried > 60


def example(cls: type[Any]) -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads(f"example = {cls.example}")["example"]
    return found


# -- the table of support ------------------------------------------------------------------------------------------

ROWS = {
    "sliding interfaces": "sliding", "cohesive interfaces": "cohesion", "gap": "gap", "boundary periodic": "periodic",
    "stages": "stages", "gradients": "objective", "friction coulomb": "coulomb",
    "friction rate_and_state_ageing": "plain",
    "nucleation friction_drop": "weakened", "boundary absorbing": "waves", "mass damping": "waves",
    "Kelvin-Voigt damping": "waves", "pore pressure": "pore pressure", "temperature": "temperature",
}  # fmt: skip
"""Rows of the table, by the feature of `CELLS` that is the same."""


def is_accepted(given: dict[str, Any]) -> bool:
    try:
        parse_case(given, HERE)
    except UnsupportedError:
        return False
    return True


def judged(name: str, topic: str, column: str) -> bool:
    """Return what the table says."""
    feature = next(feature for feature in features() if feature.name == name)
    return judge(feature, columns()[topic][column]).works


def test_the_table_says_what_cases_are_refused() -> None:
    """Cases of every stepper, contact method and feature; a cell is `yes` if the part that is free can be chosen."""
    accepted = {name: is_accepted(given) for name, given in CELLS}
    for method, stepper in product(METHODS, STEPPERS):
        contact = {"kind": method, **table(METHODS[method])}
        given = {**SMALL, "faults.main.contact": contact, "stepper": STEPS[stepper], "stages": [{"duration": 2e-6}]}
        accepted[f"{method}, {stepper}, stages"] = is_accepted(plates(given))  # without the damping of the other case
    seen = set()
    for row, feature in ROWS.items():
        for stepper in STEPPERS:
            works = any(accepted[f"{method}, {stepper}, {feature}"] for method in METHODS)
            assert judged(row, "stepper", stepper) == works, f"{row}, {stepper}"
            seen.add(works)
        if any(feature.name == row and "faults.main.contact" in feature.parts for feature in features()):
            for method in METHODS:
                works = any(accepted[f"{method}, {stepper}, {feature}"] for stepper in STEPPERS)
                assert judged(row, "contact", method) == works, f"{row}, {method}"
    for method, stepper in product(METHODS, STEPPERS):
        assert judged(f"contact {method}", "stepper", stepper) == accepted[f"{method}, {stepper}, plain"]
    for kind, stepper in product(alternatives("ruptfx.interfaces.cracks"), STEPPERS):
        assert judged(f"fracture {kind}", "stepper", stepper) == accepted[f"{kind}, {stepper}, plain"]
    for kind, method in product(alternatives("ruptfx.interfaces.cracks"), METHODS):
        beside = f"fracture {kind} beside an interface"
        assert judged(beside, "contact", method) == accepted[f"{kind} beside {method}"], f"{kind}, {method}"
    for stepper in STEPPERS:
        assert judged("large rotations", "stepper", stepper) == accepted[f"intrinsic, {stepper}, turning"]
        for kind in alternatives("ruptfx.interfaces.cracks"):
            meeting = f"collisions potential of {kind} facets"
            assert judged(meeting, "stepper", stepper) == accepted[f"{kind}, {stepper}, meeting"]
    assert seen == {True, False}


def test_contact_of_single_points_is_refused_where_points_depend_on_each_other() -> None:
    """A contact method of explicit steps without sweeps, beside extrinsic facets and on an interface that slides."""

    class SinglePoints(ContactMethod):
        pass

    choices = parse_case(faulted({"fracture.kind": "extrinsic"}), HERE).choices()
    beside = {**choices, "faults.main.contact": SinglePoints}
    (refusal,) = refusals_of(beside)
    assert refusal.keys == ("faults.main.contact",) and "neighbouring points depend on each other" in refusal.reason
    kinds = {change.kind for (change,) in remedies(beside, [refusal])}
    springs = {kind for kind, fracture in alternatives("ruptfx.interfaces.cracks").items() if not fracture.rigid}
    assert kinds == {*METHODS, *springs} and "intrinsic" in springs
    sliding = {**{key: cls for key, cls in beside.items() if key != "fracture"}, "faults.main.sliding": Sliding}
    assert [refusal.keys for refusal in refusals_of(sliding)] == [("faults.main.contact",)]


@pytest.mark.parametrize("kind", ATTACHMENTS := alternatives("ruptfx.interfaces.attachments"))
def test_the_table_says_with_which_steppers_attachments_are_refused(kind: str) -> None:
    attached = tomllib.loads(f"example = {ATTACHMENTS[kind].example}")["example"]
    found = set()
    for stepper in STEPPERS:
        given = {**SMALL, "faults.main.contact": COMPLIANT, "stepper": STEPS[stepper], "attachments": [attached]}
        assert judged(f"attachment {kind}", "stepper", stepper) == is_accepted(plates(given))
        found.add(is_accepted(plates(given)))
    assert found == {True, False}


@pytest.mark.parametrize("plane", get_args(Plane))
def test_the_table_says_in_which_planes_cases_are_refused(plane: str) -> None:
    still = {"plane": plane, "boundaries": []}
    for kind in alternatives("ruptfx.interfaces.cracks"):
        broken = block({"fracture.kind": kind, **still})
        assert judged(f"fracture {kind}", "plane", plane) == is_accepted(broken) == (plane in ("stress", "strain"))
    sliding = plates({**SMALL, "faults.main.contact": COMPLIANT, "faults.main.sliding": {}, **still})
    assert judged("sliding interfaces", "plane", plane) == is_accepted(sliding)
    turning = {**plates({**SMALL, **BARE, **still}), "large_rotations": True}
    assert judged("large rotations", "plane", plane) == is_accepted(turning)
    bonded = plates({**SMALL, "faults.main.contact": SPLIT, "faults.main.cohesion": BOND, **still})
    assert judged("cohesive interfaces", "plane", plane) == is_accepted(bonded)


@pytest.mark.parametrize("material", MATERIALS := alternatives("ruptfx.laws.materials"))
def test_the_table_says_of_which_materials_cases_are_refused(material: str) -> None:
    given = {"kind": material, **tables(MATERIALS[material], 1, lambda table: None)[0]}
    for kind in alternatives("ruptfx.interfaces.cracks"):
        broken = block({"fracture.kind": kind, "materials": {"default": given}, "operator": "ufl_form"})
        assert judged(f"fracture {kind}", "material", material) == is_accepted(broken)
        if not is_accepted(broken):
            with pytest.raises(UnsupportedError, match=r"(isotropic bodies|no memory); use .*'isotropic_elastic'"):
                parse_case(broken, HERE)
    slides = plates({**SMALL, "plane": "strain", "faults.main.contact": COMPLIANT, "faults.main.sliding": {},
                     "operator": "ufl_form", "materials": {"default": given}})  # fmt: skip
    assert judged("sliding interfaces", "material", material) == is_accepted(slides)


def test_the_table_in_the_terminal() -> None:
    shown = CliRunner(env={"COLUMNS": "240"}).invoke(app, ["describe", "support"])
    assert shown.exit_code == 0
    for topic, names in columns().items():
        assert f"feature x {topic}" in shown.output and all(name in shown.output for name in names)
    line = next(line for line in shown.output.splitlines() if "boundary periodic" in line)
    note = re.findall(r"no \((\d+)\)", line)[0]
    assert f"({note}) this stepper cannot tie nodes" in shown.output


def test_no_name_is_broken_in_a_narrow_terminal() -> None:
    """Names of steppers were printed in pieces of eight letters, one below the other."""
    shown = CliRunner(env={"COLUMNS": "80"}).invoke(app, ["describe", "support"])
    assert max(map(len, shown.output.splitlines())) <= 80
    assert [name for names in columns().values() for name in names if name not in shown.output] == []


# -- remedies -------------------------------------------------------------------------------------------------------


def elastic(stepper: str) -> set[str]:
    """Return the contact methods with a stiffness that the steps can use."""
    ways = STEPPERS[stepper].time_schemes
    return {kind for kind, cls in METHODS.items()
            if "stiffness" in cls.offers and all(getattr(cls, way) for way in ways)}  # fmt: skip


@pytest.mark.parametrize("stepper", ["petsc_ts", "quasi_dynamic"])
@pytest.mark.parametrize("method", ["split_node", "forward_lagrange", "augmented_lagrangian"])
def test_no_remedy_leads_in_a_circle(stepper: str, method: str) -> None:
    """Messages named rigid kinds of contact in turn; these steps take springs."""
    with pytest.raises(UnsupportedError) as refused:
        parse_case(plates({
            "stepper": {"kind": stepper}, "faults.main.contact": {"kind": method}, "faults.main.friction": AGEING,
        }))  # fmt: skip
    kinds = {c.kind for changes in refused.value.remedies for c in changes if c.keys == ("faults.main.contact",)}
    assert kinds == elastic(stepper) != set()


def test_faults_of_one_kind_change_together() -> None:
    """Two of three interfaces have contact that the steps cannot use: one remedy for both of them."""
    rest = {"friction": {"kind": "coulomb", "mu_d": 0.6}, "initial_stress": {"normal": 1e6}}
    faults = {name: {**rest, "contact": given} for name, given in (("a", SPLIT), ("b", SPLIT), ("c", COMPLIANT))}
    with pytest.raises(UnsupportedError, match=r"^faults\.a\.contact\.kind = .*, faults\.b\.contact\.kind") as refused:
        parse_case(plates({"faults": faults, "stepper": {"kind": "petsc_ts"}}))
    keys = ("faults.a.contact", "faults.b.contact")
    assert [change.kind for (change,) in refused.value.remedies if change.keys == keys] == [*elastic("petsc_ts")]


# -- keys without effect -------------------------------------------------------------------------------------------

WAVE = {"kind": "incident_wave", "edge": "upper.right", "wave": "P", "direction": [-1.0, 0.0], "velocity": 1.0,
        "history": {"kind": "ricker", "frequency": 3e5, "delay": 4e-6}}  # fmt: skip
BARE = {"faults": {}, "mesh": {"kind": "pieces", "element_size": 1e-3, "bodies": {
    "plate": {"kind": "rectangle", "center": [0.0, 0.0], "width": 4e-3, "height": 2e-3}}}}  # fmt: skip


@pytest.mark.parametrize("stepper", [kind for kind, cls in STEPPERS.items() if "inertia" not in cls.offers])
@pytest.mark.parametrize("key, changes", [
    ("boundaries.3.kind", {"boundaries": [*SMALL["boundaries"], ABSORBS]}),
    ("boundaries.3.kind", {"boundaries": [*SMALL["boundaries"], WAVE]}),
    ("damping.mass", {"damping.mass": 1e3}),
    ("damping.kelvin_voigt", {"damping.kelvin_voigt": {"eta": 1e-8}}),
    ("damping.kelvin_voigt", {"damping.kelvin_voigt": {}}),
    ("stages.1.damping.mass", {"stages": [{"duration": 1e-6}, {"duration": 1e-6, "damping": {"mass": 1.0}}]}),
    ("stages.0.boundaries.0.kind", {"stages": [{"duration": 2e-6, "boundaries": [ABSORBS]}]}),
])  # fmt: skip
def test_steps_without_waves_refuse_what_acts_on_waves(stepper: str, key: str, changes: dict[str, Any]) -> None:
    """The same case is accepted by steps with waves, and by those that change between both."""
    given = {**SMALL, **changes, "faults.main.contact": COMPLIANT}
    with pytest.raises(UnsupportedError, match=facts(rf"{re.escape(key)}.*stepper\.kind = '{stepper}'")):
        parse_case(plates({**given, "stepper": {"kind": stepper}}))
    for other in ("leapfrog", "generalized_alpha", "hybrid"):
        Model(parse_case(plates({**given, "stepper": {"kind": other}})))


@pytest.mark.parametrize("key, changes", [
    ("output.rupture_threshold = 0.5", {**BARE, "output.rupture_threshold": 0.5}),
    ("output.rupture_after = 1e-06", {**BARE, "output.rupture_after": 1e-6}),
    ("stop_when.sliding_dead_for = 1e-06", {**BARE, "stop_when": {"sliding_dead_for": 1e-6}}),
    ("output.plate_thickness = 0.01", {"plane": "antiplane", "boundaries": [], "output.plate_thickness": 0.01}),
    ("output.plate_thickness = 0.01", {"plane": "axisymmetric", "boundaries": [], "output.plate_thickness": 0.01}),
    ("output.plate_thickness = 0.01", {"plane": "solid", "boundaries": [], "output.plate_thickness": 0.01}),
    ("materials.default.fringe_constant = 26000",
     {"plane": "antiplane", "boundaries": [], "materials.default.fringe_constant": 26e3}),
    ("materials.upper.fringe_constant = 26000",
     {"plane": "axisymmetric", "boundaries": [], "materials.upper": {**HOMALITE, "fringe_constant": 26e3}}),
    ("damping.kelvin_voigt: fraction = 0.2: without effect beside eta = 1e-08",
     {"damping.kelvin_voigt": {"fraction": 0.2, "eta": 1e-8}}),
    ("boundaries.3.kind = 'free'", {"boundaries": [*SMALL["boundaries"], {"kind": "free", "edge": "upper.top"}]}),
    ("stages.0.boundaries.0.kind = 'free'", {"stages": [{"duration": 2e-6, "boundaries": [
        {"kind": "free", "edge": "upper.top"}, PUSH]}]}),
])  # fmt: skip
def test_keys_without_effect_are_refused(key: str, changes: dict[str, Any]) -> None:
    with pytest.raises(CaseError, match=f"^{facts_of(key)}"):
        parse_case(plates({**SMALL, "faults.main.contact": COMPLIANT, **changes}))


@pytest.mark.parametrize("changes, message", [
    ({"fracture": {"kind": "intrinsic", "default": {"cohesion": BOND, "friction": {"kind": "coulomb", "mu_d": 0.0}}}},
     "plane = 'solid': bodies break in plane stress and plane strain only"),
    ({"collisions": {"kind": "potential"}}, "collisions, plane = 'solid': in plane stress and strain only; remove"),
    ({"large_rotations": True}, "large_rotations, plane = 'solid': in plane stress and plane strain only; remove"),
])  # fmt: skip
def test_what_is_for_planes_is_refused_at_once_in_three_dimensions(changes: dict[str, Any], message: str) -> None:
    """Order 2 and stress of the fault, which fracture refuses in a plane, are not named first."""
    with pytest.raises(CaseError, match=facts_of(message)):
        parse_case(strike_slip(changes))


@pytest.mark.parametrize("key, value", [
    ("stop_when", {"sliding_dead_for": 1e-6}), ("output.rupture_after", 1e-6), ("output.rupture_threshold", 0.5),
])  # fmt: skip
def test_bodies_that_break_have_no_interface_that_could_die_or_rupture(key: str, value: Any) -> None:
    with pytest.raises(CaseError, match=facts(rf"^{key}.*there is no interface")):
        parse_case(block({key: value}), HERE)


def test_a_resolved_case_gives_defaults_of_keys_that_would_be_refused() -> None:
    for given in (parse_case(block({}), HERE), parse_case(plates({"damping.kelvin_voigt": {"eta": 1e-8}}))):
        assert parse_case(given.table()) == given


@pytest.mark.parametrize("key, added", [
    ("boundaries.3.edge = 'upper.top'", {**PUSH, "velocity": 5.0}),
    ("boundaries.3.edge = 'upper.top'", {"kind": "moved", "edge": "upper.top", "component": "x",
                                         "quantity": "velocity", "times": [0.0, 1.0], "values": [0.0, 1.0]}),
    ("boundaries.3.edge = 'upper.top'", {**PUSH, "x_range": [0.0, 2e-3]}),
    ("boundaries.3.kind = 'traction': without effect in x", {"kind": "traction", "edge": "upper.top",
                                                            "traction": [1e6, 1e6]}),
    ("boundaries.3.kind = 'traction': without effect in y", {"kind": "traction", "edge": "lower.bottom",
                                                            "traction": [0.0, 1e6]}),
    ("boundaries.3.kind = 'spring': without effect in x", {"kind": "spring", "edge": "upper.top", "normal": 1e12,
                                                          "tangential": 1e12}),
    ("boundaries.3.kind = 'absorbing': without effect, ", {"kind": "absorbing", "edge": "lower.bottom"}),
    ("boundaries.3.kind = 'incident_wave': without effect, ", {**WAVE, "edge": "lower.bottom"}),
    ("boundaries.3.kind = 'point_force': without effect in x", {"kind": "point_force", "point": [2e-3, 2e-3],
                                                               "force": [1.0, 1.0]}),
])  # fmt: skip
def test_edges_that_are_driven_take_nothing_else_in_that_direction(key: str, added: dict[str, Any]) -> None:
    given = plates({**SMALL, "faults.main.contact": COMPLIANT})
    given["boundaries"] = [*given["boundaries"], added]
    with pytest.raises(CaseError, match=f"^{facts_of(key)}"):
        Model(parse_case(given))
    staged = merged(given, {"boundaries": [], "stages": [{"duration": 2e-6, "boundaries": given["boundaries"]}]})
    with pytest.raises(CaseError, match=f"^stages.0.{facts_of(key)}"):
        stages.bind(Model(parse_case(staged)))


@pytest.mark.parametrize("entries", [
    [{**PUSH, "x_range": [0.0, 2e-3]}, {**PUSH, "x_range": [2e-3, 4e-3], "velocity": 5.0}],  # a node in common
    [PUSH, {**PUSH, "component": "y"}],
    [PUSH, {**PUSH, "edge": "upper.left"}],  # a corner in common
    [PUSH, {"kind": "traction", "edge": "upper.top", "traction": [0.0, 1e6]}],
    [PUSH, {"kind": "absorbing", "edge": "upper.top"}],  # in y
    [PUSH, {"kind": "spring", "edge": "upper.top", "normal": 1e12}],
    [{**PUSH, "x_range": [0.0, 2e-3]}, {"kind": "traction", "edge": "upper.top", "traction": [1e6, 0.0]}],
])  # fmt: skip
def test_edges_with_several_boundaries_that_all_act(entries: list[dict[str, Any]]) -> None:
    Model(parse_case(plates({**SMALL, "order": 2, "faults.main.contact": COMPLIANT, "boundaries": entries})))


def solid_blocks(changes: dict[str, Any]) -> dict[str, Any]:
    """Return two flat solids that slide, pressed by 6 MPa, with a law whose rates implicit steps can take."""
    plan = {"length": 1e-3, "width": 1e-3, "height": 0.5e-3}
    upper = {**plan, "element_size": 0.5e-3}
    lower = {**plan, "left": -0.2e-3, "front": -0.2e-3, "length": 1.4e-3, "width": 1.4e-3, "element_size": 0.35e-3}
    table = solids({
        "order": 1, "mesh.upper": upper, "mesh.lower": lower, "faults.main.initial_stress": {"normal": 6e6},
        "faults.main.friction": AGEING | {"V_initial": 1e-6}, "operator": "ufl_form",
    })  # fmt: skip
    return merged({**table, "boundaries": [*table["boundaries"][:3], *(
        {**PUSH, "component": axis, "velocity": 1e-3 * (axis == "x")} for axis in "xyz"
    )]}, changes)  # fmt: skip


def makes_a_step(given: dict[str, Any]) -> bool:
    """Return whether a case is accepted; its first step then has finite tractions under pressure."""
    if not is_accepted(given):
        return False
    model = Model(parse_case(given, HERE))
    motion, state = stages.bind(model), model.initial_state()
    motion.step(state)
    fields = state.faults["main"]
    assert state.time > 0 and np.all(np.isfinite(fields["slip_1"])) and np.all(np.isfinite(fields["slip_2"]))
    assert fields["normal_stress"].max() > 1e6
    return True


@pytest.mark.slow
@pytest.mark.parametrize("stepper", STEPPERS)
def test_steppers_and_contact_of_the_row_of_sliding_make_steps_of_solids(stepper: str) -> None:
    """Every cell that says `yes` makes a step with some contact method, and every other one is refused."""
    works = {method: makes_a_step(solid_blocks({
        "stepper": STEPS[stepper], "faults.main.contact": {"kind": method, **table(METHODS[method])},
    })) for method in METHODS}  # fmt: skip
    assert judged("sliding interfaces", "stepper", stepper) == any(works.values())
    assert all(judged("sliding interfaces", "contact", method) for method in METHODS if works[method])


@pytest.mark.pairs
@pytest.mark.parametrize("material", MATERIALS)
def test_materials_of_the_row_of_sliding_make_steps_of_solids(material: str) -> None:
    given = {"kind": material, **tables(MATERIALS[material], 1, lambda table: None)[0]}
    given.pop("fringe_constant", None)
    case = solid_blocks({"faults.main.contact": COMPLIANT, "stepper": STEPS["leapfrog"]})
    works = judged("sliding interfaces", "material", material) and "solid" in MATERIALS[material].planes()
    assert makes_a_step({**case, "materials": {"default": given}}) == works
