"""Every key of a case changes the results or is refused, in every plane, in three dimensions and with every stepper.

Keys are found in the classes of the case, so that a new one is tried without an edit here. Each gets other values until
one of them changes the state of a few steps, of the stop rules, or for keys of records the files of a run.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from itertools import count, product
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, merged, required

from ruptfx import RuptfxError
from ruptfx.app.check_law.examples import choices, flat, folder, number, properties, table
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import Alternative, CaseError, Part, alternatives, package_of, set_key, unit_of

pytest.importorskip("dolfinx")

from ruptfx.run import stages
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.stopping import StopRules

pytestmark = pytest.mark.fem

NO_NUMBERS = {
    r"title": "heads figures and tables",
    r"positions": "says that the user knows what positions are; without effect where interfaces begin at x = 0",
    r"(objective|unknowns|inference|reconstruction).*": "what `ruptfx gradient`, `infer` and `reconstruct` do",
    r"plugins": "files that define kinds; what they define counts",
    r"output\.figures": "whether figures are drawn",
    r"output\.checkpoint_(minutes|steps)": "when a run may go on from; the records are the same",
    r"output\.plate_thickness": "figures of fringes read it from case.toml; refused where there are no plates",
    r"materials\.\w+\.fringe_constant": "the same",
    r"operator": "operators agree to rounding",
    r"mesh\.half": "removes the edges of `minus` that are loaded here; test_half_models.py compares it with the whole",
    r"stepper(\.slow)?\.petsc_options": "options of solvers, which agree to their tolerance",
    r"faults\.\w+\.contact\.(penalty|tolerance|sweeps)": "of iterations, which agree to their tolerance",
    r"stepper\.rate_tolerance": "of an error that counts beside `slip_tolerance` where slip rates change a lot",
    r"stepper\.halvings": "a bound that only steps without equilibrium reach",
    r"stepper\.(slow\.)?smallest_step": "a bound that only steps which run away reach",
    r"faults\.\w+\.sliding\.limit": "a bound that only long implicit steps reach",
    r"stepper\.slow\.\w+": "those of `quasi_static`, which are tried there",
    r"stepper\.(calm_for|slow_below)": "when hybrid steps come back from fast ones, long after the steps here",
    r"stop_when\.\w+": "a rule that must be met",
    r"attachments\.\w+\.name": "of a group of attachments.h5",
    r"cameras(\..*)?": "films are made from the records",
    r"instruments\.\w+\.fault": "names the interface of several",
    r"instruments\.\w+\.stations": "gives the points that are in the case; test_stations.py",
    r"faults\.main\.initial_stress\.(normal\.profile|shear\.terms\.3)\.(file|variable)": "gives the lists beside it",
}
"""Keys that may leave the numbers as they are, and why."""
IN_PLANES = {"antiplane": {r"faults\.\w+\.contact\.C_n": "required, and nothing moves along the normal"}}
"""The same in some planes only."""

AGEING = {"kind": "rate_and_state_ageing", "a": 0.012, "b": 0.008, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-3,
          "V_initial": 1e-4}  # fmt: skip
TOUGH = {"kind": "linear", "f_t": 1e5, "c": 2e5, "G_Ic": 10.0, "G_IIc": 30.0}
PLATES = {"kind": "two_plates", "length": 4e-3, "height": 4e-3, "element_size": 2e-3}
PLANES: dict[str, dict[str, Any]] = {
    "stress": {}, "strain": {}, "antiplane": {},
    "axisymmetric": {"mesh": {"kind": "fibre_in_matrix", "radius": 4e-3, "outer_radius": 8e-3, "length": 4e-3,
                              "element_size": 2e-3}},
    "solid": {"mesh": {"kind": "extruded", "section": PLATES, "thickness": 4e-3, "layers": 2}},
}  # fmt: skip
# Steps that follow their error; fast ones after the first; steps that grow until their error counts.
OF_STEPPERS = {
    "quasi_static": {"smallest_step": 1e-15},
    "hybrid": {"fast_above": 1e-5, "slow_below": 1e-6},
    "quasi_dynamic": {"first_step": 1e-7, "largest_step": 1e-3},
}
STRINGS = {
    "edge": ["upper.left", "upper.top", "matrix.top", "matrix.right", "matrix.left", "plus.left", "plus.top"],
    "body": ["upper", "lower", "plus", "minus"],
    "direction": ["x", "y"], "operator": ["ufl_form"], "name": ["another"],
    "first": ["lower.left"], "second": ["lower.right"], "bodies": ["upper", "lower", "matrix", "plus"],
}  # fmt: skip
"""Other values of text, by the name of the key."""
EXAMPLES = {"cracks": {"default": {"friction": {"kind": "coulomb", "mu_d": 0.6}}}}
"""Tables of a folder that cannot be made from types."""
FEW = 6  # steps
NO_VALUE = r"no such|unknown|[Ii]nput should|required"  # refusals of the value that was tried, not of the key


def base(plane: str, stepper: str) -> dict[str, Any]:
    """Two bodies that slide under a drive and a load, with whatever the stepper has a use for."""
    steps, upper, lower = alternatives("ruptfx.stepping.steppers")[stepper], "upper", "lower"
    if plane == "axisymmetric":
        upper, lower = "matrix", "fibre"
    along = "z" if plane == "antiplane" else "x"
    traction = {"antiplane": [1e5], "solid": [1e5, 2e5, 3e4]}.get(plane, [1e5, 2e5])
    boundaries = [
        {"kind": "driven", "edge": f"{upper}.top", "component": along, "velocity": 0.5, "ramp": 1e-6},
        {"kind": "driven", "edge": f"{lower}.left", "component": along, "velocity": 0.01},
        {"kind": "traction", "edge": f"{upper}.right", "traction": traction, "ramp": 1e-6},
    ]  # fmt: skip
    if along == "x" and plane != "axisymmetric":
        boundaries.append({**boundaries[1], "edge": f"{lower}.bottom", "component": "y"})
    if plane == "solid":
        boundaries.append({**boundaries[1], "edge": f"{lower}.back", "component": "z"})
    if "inertia" in steps.offers:
        boundaries.append({"kind": "absorbing", "edge": f"{lower}.right"})
    given = {
        "plane": plane, "order": 1, "duration": 3e-6, "mesh": PLATES, "materials": {"default": HOMALITE},
        "faults": {"main": {
            "contact": COMPLIANT, "friction": AGEING, "initial_stress": {"normal": 6e6, "shear": 3.59e6},
            "nucleation": [{"kind": "overstress", "extra": 1e4}],
        }},
        "boundaries": boundaries, "damping": {"mass": 1e4, "kelvin_voigt": {}} if "inertia" in steps.offers else {},
        "stepper": {"kind": stepper, **required(stepper), **OF_STEPPERS.get(stepper, {})},
        "output": {"figures": False, "rupture_threshold": 1e-5},
    }  # fmt: skip
    return merged(given, PLANES[plane])


def around_a_surface(stepper: str) -> dict[str, Any]:
    """A box around a fault, with every profile over a surface."""
    terms = [
        3.4e6, {"kind": "rectangle", "inside": 1e5, "outside": 0.0, "strike": [-1e-3, 2e-3], "dip": [0.0, 2e-3]},
        {"kind": "ellipse", "inside": 6e4, "outside": 2e4, "strike": [-1e-3, 2e-3], "dip": [1e-3, 4e-3]},
        {"kind": "surface_table", "strike": [-3e-3, 0.5e-3, 3e-3], "dip": [0.0, 4e-3],
         "values": [[0.0, 2e4, 1e4], [2e4, 0.0, 4e4]]},
    ]  # fmt: skip
    table = {"kind": "table", "positions": [0.0, 1e-3, 3e-3], "values": [5.8e6, 6e6, 6.2e6], "extend": True}
    given = base("solid", stepper)
    for boundary, edge in zip(
        given["boundaries"],
        ("plus.far", "minus.left", "plus.right", "minus.far", "minus.bottom", "minus.right"),
        strict=True,
    ):
        boundary["edge"] = edge
    return merged(given, {
        "positions": "x",
        "mesh": {"kind": "box_with_fault", "fault_length": 4e-3, "fault_width": 6e-3, "element_size": 2e-3,
                 "beyond": 2e-3, "distance": 6e-3, "growth": 1.1},
        "faults.main.initial_stress": {
            "normal": {"kind": "along_dip", "profile": table}, "shear": {"kind": "sum", "terms": terms}, "rake": 20.0,
        },
        "faults.main.nucleation": [
            {"kind": "smooth_patch", "extra": 1e5, "center": 0.5e-3, "radius": 3e-3, "rise": 1e-6},
        ],
    })  # fmt: skip


def others(cls: type[Part], name: str, value: Any) -> list[Any]:
    """Other values of a key, the likeliest to change something first."""
    schema = properties(cls).get(name, {})
    options = flat(schema)
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, str):
        enum = [word for item in options for word in item.get("enum", [])]
        return [word for word in enum or STRINGS.get(name, [f"{value}x"]) if word != value]
    if isinstance(value, int) and not any(item.get("type") == "number" for item in options):
        return [value + 1, 2 * value + 1, max(value - 1, 1)]
    if isinstance(value, int | float):
        return [scale * value for scale in (2.0, 0.5, 1e3, 1e-3, 1.05)] if value else _numbers(cls, name, options)
    if isinstance(value, list) and value and all(isinstance(item, int | float) for item in value):
        return [[2.0 * item for item in value], [item + 1e-3 for item in value]]
    if isinstance(value, list) and value and isinstance(value[0], str):
        return [value[:1]]
    if isinstance(value, list) and value and isinstance(value[0], list):
        return [[[2.0 * item for item in row] for row in value]]
    return _given(cls, name, schema, options)


def _numbers(cls: type[Part], name: str, options: list[dict[str, Any]]) -> list[Any]:
    limits = next(item for item in options if item.get("type") in ("number", "integer"))
    if limits["type"] == "integer":
        return [max(2, limits.get("minimum", 0))]
    first = number(0, name, unit_of(cls, name), limits)
    return [scale * first for scale in (1.0, 1e-2, 1e2, 1e-4, 1e4, 1e-6, 1e-9)]


def _given(cls: type[Part], name: str, schema: Mapping[str, Any], options: list[dict[str, Any]]) -> list[Any]:
    """Values of a key that is not given: numbers, tables of its class, or of every kind of its folder."""
    kinds = folder(dict(schema)) or schema.get("items", {}).get("x-folder")
    inside = [item for item in _types(cls.model_fields[name].annotation) if issubclass(item, Part)]
    inside = [item for item in inside if item is not Alternative]
    several = schema.get("type") == "array"
    if kinds == "boundaries":
        return [[]]
    if inside and not kinds:
        return [[table(inside[0])] if several else table(inside[0])]
    if kinds:
        known = alternatives(package_of(kinds)).items()
        tables = [
            {"kind": kind, **each} for kind, found in known
            for each in ([EXAMPLES[kinds]] if kinds in EXAMPLES else _examples(found))
        ]  # fmt: skip
        return [[item] for item in tables] if several else tables
    if "patternProperties" in schema or schema.get("type") == "object":
        return [{body: [1.0, 2.0]} for body in ("upper", "lower", "matrix", "fibre", "rock")]
    if any(item.get("type") in ("number", "integer") for item in options):
        return _numbers(cls, name, options)
    if any("const" in item for item in choices(dict(schema))):
        return [next(item["const"] for item in options if "const" in item)]
    if any(item.get("items", {}).get("type") == "string" for item in (schema, *options)):
        return [[word] for word in STRINGS.get(name, [])]
    if schema.get("type") == "array" or any(item.get("type") == "array" for item in options):
        limits = next(item for item in (schema, *options) if item.get("type") == "array")
        return [[1e-3 * (1 + i) for i in range(size)] for size in {limits.get("minItems", 2), 3}]
    if any(item.get("type") == "string" for item in options):
        return STRINGS.get(name, [])
    return []


def _types(annotation: Any) -> Iterator[type]:
    """All classes in an annotation."""
    if isinstance(annotation, type) and not get_args(annotation):
        yield annotation
    for inner in get_args(annotation):
        yield from _types(inner)


def _examples(cls: type[Part]) -> list[dict[str, Any]]:
    """Return tables of a class: made from types, or its own example on every edge that there may be."""
    try:
        return [table(cls)]
    except (NotImplementedError, CaseError):
        text = getattr(cls, "example", "")
        given = tomllib.loads(f"it = {text}")["it"] if text else {}
        return [{**given, "edge": edge} for edge in STRINGS["edge"]] if "edge" in given else [given]


def keys(part: Part, prefix: str = "") -> Iterator[tuple[str, type[Part], str, Any]]:
    """Every key of a part and of all parts in it."""
    for name in type(part).model_fields:
        value, key = getattr(part, name), f"{prefix}{name}"
        inner = [(f"{key}.", value)] if isinstance(value, Part) else []
        if isinstance(value, Mapping):
            inner = [(f"{key}.{entry}.", item) for entry, item in value.items()]
        elif isinstance(value, list):
            inner = [(f"{key}.{entry}.", item) for entry, item in enumerate(value)]
        inner = [(where, item) for where, item in inner if isinstance(item, Part)]
        for where, item in inner:
            yield from keys(item, where)
        if not inner:
            yield key, type(part), name, value


def state_after(case: Case) -> dict[str, Any]:
    """What a few steps leave, by name."""
    model = Model(case)
    motion, state, rules = stages.bind(model), model.initial_state(), StopRules(model, model.case.stop_when)
    ended = []
    for _ in range(FEW):
        motion.step(state)
        rules.check(state)
        ended.append(rules.ended)
    found: dict[str, Any] = {"u": state.displacement, "v": state.velocity, "t": np.array([state.time, motion.dt])}
    found |= {f"{fault}.{name}": values for fault, fields in state.faults.items() for name, values in fields.items()}
    found |= {f"cracks.{name}": values for name, values in state.cracks.items()}
    return found | {"energies": np.array(list(motion.energies(state).values())), "ended": ended}


def files_of(case: Case, out: Path) -> dict[str, Any]:
    """What a run leaves, by file and dataset; without texts that repeat the case."""
    simulate(case, out, progress=False).close()
    found: dict[str, Any] = {"files": sorted(path.name for path in out.rglob("*"))}
    for path in out.glob("*.h5"):
        with h5py.File(path) as file:

            def keep(name: str, item: Any, path: Path = path) -> None:
                if isinstance(item, h5py.Dataset):
                    found[f"{path.name}.{name}"] = item[()]
                    found[f"{path.name}.{name}, kept as"] = [str(item.dtype), str(item.compression_opts)]

            file.visititems(keep)
    return found | {path.name: path.read_text() for path in out.glob("*.csv")}


def differ(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether results differ by more than rounding."""
    if one.keys() != other.keys():
        return True
    for name, values in one.items():
        if isinstance(values, np.ndarray) and values.dtype.kind == "f":
            a, b = values, other[name]
            size = np.abs(a, where=np.isfinite(a), out=np.zeros_like(a)).max(initial=0.0)
            if a.shape != b.shape or not np.allclose(a, b, rtol=0.0, atol=1e-13 * size, equal_nan=True):
                return True
        elif np.any(values != other[name]):
            return True
    return False


def silent(given: dict[str, Any], chosen: Any, results: Any) -> list[str]:
    """Keys of a case that change nothing and are not refused by name."""
    first, bare = results(parse_case(given)), []
    spared = {**NO_NUMBERS, **IN_PLANES.get(given["plane"], {})}
    for key, cls, name, value in keys(parse_case(given)):
        if not chosen(key) or any(re.fullmatch(pattern, key) for pattern in spared):
            continue
        for other in others(cls, name, value):
            changed = parse_case(given).table()
            try:
                set_key(changed, key, other)
                if differ(first, results(parse_case(changed))):
                    break
            except RuptfxError as refused:
                named = name in str(refused) or key.rpartition(".")[0].rpartition(".")[2] in str(refused)
                if named and not re.search(NO_VALUE, str(refused)):
                    break
        else:
            bare.append(key)
    return bare


def of_records(key: str) -> bool:
    """Return whether a key is of what is recorded only.

    The stress of elastic bodies acts on snapshots only where interfaces have tractions of their own.
    """
    of_output = key.startswith(("output.", "instruments")) and "rupture" not in key
    return of_output or key in ("duration", "initial_stress")


PAIRS = [(plane, "leapfrog") for plane in PLANES] + [
    ("stress", kind) for kind in alternatives("ruptfx.stepping.steppers") if kind != "leapfrog"
] + [("antiplane", "quasi_dynamic"), ("axisymmetric", "quasi_static")]  # fmt: skip

OTHERS = [pair for pair in product(PLANES, alternatives("ruptfx.stepping.steppers")) if pair not in PAIRS]


@pytest.mark.parametrize("plane, stepper", PAIRS)
def test_every_key_changes_the_motion_or_is_refused(plane: str, stepper: str) -> None:
    """In one plane all steppers, in explicit steps all planes."""
    assert silent(base(plane, stepper), lambda key: not of_records(key), state_after) == []


def test_every_key_around_a_surface_changes_the_motion_or_is_refused() -> None:
    assert silent(around_a_surface("leapfrog"), lambda key: not of_records(key), state_after) == []


@pytest.mark.parametrize("number", range(len(OTHERS)))
def test_every_key_in_one_of_the_other_pairs(number: int) -> None:
    """Every key is tried in one more plane with one more stepper: keys are dealt to the pairs in turn."""
    given, dealt = base(*OTHERS[number]), count()

    def chosen(key: str) -> bool:
        return not of_records(key) and next(dealt) % len(OTHERS) == number

    assert silent(given, chosen, state_after) == []


def test_every_key_of_records_changes_a_file_or_is_refused(tmp_path: Path) -> None:
    """Names, sizes and numbers of files, and how the numbers are kept."""
    given = merged(base("stress", "leapfrog"), {"output.interface_interval": 1e-6, "instruments": [
        {"kind": "receiver", "name": "one", "interval": 1e-6, "point": [1e-3, 1e-3], "bandwidth": 1e6},
    ]})  # fmt: skip
    runs = count()
    assert silent(given, of_records, lambda case: files_of(case, tmp_path / str(next(runs)))) == []


def test_every_key_of_records_in_three_dimensions(tmp_path: Path) -> None:
    """Receivers have three coordinates; fields have components along strike and down dip."""
    given = merged(around_a_surface("leapfrog"), {"output.interface_interval": 1e-6, "instruments": [
        {"kind": "receiver", "name": "one", "interval": 1e-6, "point": [1e-3, 1e-3, -1e-3], "bandwidth": 1e6},
        {"kind": "fault_receiver", "name": "two", "interval": 1e-6, "point": [0.0, 0.0, -2e-3]},
    ]})  # fmt: skip
    runs = count()
    assert silent(given, of_records, lambda case: files_of(case, tmp_path / str(next(runs)))) == []


@pytest.mark.parametrize("kind", alternatives("ruptfx.interfaces.attachments"))
def test_every_key_of_attachments_changes_the_motion_or_is_refused(kind: str) -> None:
    (each,) = _examples(alternatives("ruptfx.interfaces.attachments")[kind])[:1]
    given = merged(base("stress", "leapfrog"), {"attachments": [{"kind": kind, **each}]})
    assert silent(given, lambda key: key.startswith("attachments."), state_after) == []
