"""Case files: round trip, hash, overrides, and what is said about a file that cannot be used."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from helpers.messages import facts, facts_of, says
from helpers.small_cases import impact, merged, plates

from ruptfx.app.reference.describe import file_schema
from ruptfx.case import override, parse_case, read_case
from ruptfx.input.schema import CaseError
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.many_runs.study import read_study
from ruptfx.stepping.steppers.leapfrog import Leapfrog

DEMOS = sorted((Path(__file__).parents[2] / "demos").rglob("*.toml"))


def refusal(changes: dict[str, Any]) -> str:
    with pytest.raises(CaseError) as caught:
        parse_case(merged(impact(6e6, 2.0), changes))
    return str(caught.value)


@pytest.mark.parametrize(
    "changes, said",
    [
        # Unknown keys, at every depth: the key, and the nearest known one.
        ({"duratoin": 1e-6}, "case: unknown key 'duratoin', did you mean 'duration'?"),
        ({"faults.main.friction.law.mu_x": 0.1}, "unknown key 'mu_x', did you mean 'mu_"),
        ({"mesh.hieght": 1.0}, "mesh: unknown key 'hieght', did you mean 'height'?"),
        ({"output.zzzz": 1.0}, "output: unknown key 'zzzz', known: "),
        # Kinds
        ({"faults.main.contact": {"kind": "compliantt"}}, "unknown kind 'compliantt', did you mean 'compliant'?"),
        ({"faults.main.contact": {"C_n": 1e11, "C_s": 1e11}}, "'kind' is required, one of: "),
        ({"boundaries": [{"kind": "drivn", "edge": "upper.left"}]},
         "boundaries.0: unknown kind 'drivn', did you mean 'driven'?"),
        ({"faults.main.initial_stress.normal": {"kind": "box"}}, "unknown kind 'box', did you mean 'boxcar'"),
        # Numbers
        ({"duration": "60e-6"}, "duration = '60e-6': input should be a valid number"),
        ({"faults.main.initial_stress.normal": "30e6"}, "faults.main.initial_stress.normal = '30e6': input should be"),
        ({"duration": True}, "duration = True: input should be a valid number"),
        ({"duration": float("inf")}, "duration = inf: input should be a finite number"),
        ({"materials.default.young_modulus": -5.3e9},
         "materials.default.young_modulus = -5300000000.0: input should be greater than 0"),
        ({"materials.default.poisson_ratio": 0.5}, "materials.default.poisson_ratio = 0.5: input should be less than"),
        ({"faults.main.contact.C_s": 0.0}, "faults.main.contact.C_s = 0.0: input should be greater than 0"),
        ({"faults.main.initial_stress.normal": -1e6}, "faults.main.initial_stress.normal = -1000000.0: input should"),
        ({"order": 9}, "order = 9: input should be less than or equal to 8"),
        ({"order": 4.5}, "order = 4.5"),
        ({"stepper": {"kind": "leapfrog", "safety": 1.5}}, "stepper.safety = 1.5: input should be less than or equal"),
        # Missing, and what does not fit together
        ({"duration": None}, "duration: this key is required and missing"),
        ({"materials.default.density": None}, "materials.default.density: this key is required and missing"),
        ({"operator": "matrix_fre"}, "no such operator, did you mean 'matrix_free'?"),
        ({"plane": "antiplane"}, "boundaries.0.component = 'x': plane = 'antiplane' moves in z only"),
        ({"boundaries": [{"kind": "traction", "edge": "upper.top", "traction": [1.0]}]},
         "boundaries.0.traction: 2 components are needed (xy)"),
        ({"plane": "stresss"}, "plane = 'stresss'"),
        # Tables are named, not shown.
        ({"boundaries": [{"kind": "driven", "edge": "upper.left", "component": "z", "velocity": 1.0}]},
         "case: boundaries.0.component = 'z': plane = 'stress' moves in xy only"),
        ({"faults.main.contact": {"kind": "split_node", "C_n": 1.0}}, "unknown key 'C_n', there are none"),
    ],
)  # fmt: skip
def test_refusals_name_the_key_the_value_and_the_remedy(changes: dict[str, Any], said: str) -> None:
    assert says(said, refusal(changes))


def test_all_mistakes_are_listed_at_once() -> None:
    message = refusal({"duration": "long", "materials.default.density": -1.0, "mesh.height": 0.0})
    lines = message.splitlines()
    assert len(lines) == 3
    assert {line.partition(" ")[0] for line in lines} == {"duration", "materials.default.density", "mesh.height"}


def test_unknown_keys_are_listed_with_all_other_mistakes() -> None:
    changes = {"duration": None, "duratoin": 1e-6, "order": 9, "mesh.hieght": 1.0, "mesh.length": -1.0}
    assert sorted(refusal(changes).splitlines()) == [
        "case: unknown key 'duratoin', did you mean 'duration'?",  # which is hence not reported as missing
        "mesh.length = -1.0: input should be greater than 0",
        "mesh: unknown key 'hieght', did you mean 'height'?",
        "order = 9: input should be less than or equal to 8",
    ]


def test_python_and_files_refuse_alike() -> None:
    with pytest.raises(CaseError, match=facts(r"Coulomb\.mu_d = -1\.0: input should be greater")):
        Coulomb(mu_d=-1.0)
    with pytest.raises(CaseError, match=facts(r"unknown key 'mu_e', did you mean 'mu_d'")):
        Coulomb(mu_e=1.0)  # type: ignore[call-arg]


def test_files(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=facts(r"none\.toml: cannot be read: No such file")):
        read_case(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("duration = \n")
    with pytest.raises(CaseError, match=facts(r"bad\.toml: not valid TOML: .*line 1")):
        read_case(tmp_path / "bad.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CaseError, match=facts(r"binary\.toml: cannot be read")):
        read_case(tmp_path / "binary.toml")
    with pytest.raises(CaseError, match=f"{tmp_path}: "):
        read_case(tmp_path)
    (tmp_path / "case.toml").touch()
    with pytest.raises(CaseError, match=facts(r"a run directory; its case is .*case\.toml, and 'ruptfx resume'")):
        read_case(tmp_path)


def test_every_line_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(tomli_w.dumps(plates({"duration": "x", "order": 0})))
    with pytest.raises(CaseError) as caught:
        read_case(path)
    assert all(line.startswith(f"{path}: ") for line in str(caught.value).splitlines())


@pytest.mark.parametrize("path", DEMOS, ids=[path.name for path in DEMOS])
def test_demos_are_valid_and_round_trip(path: Path) -> None:
    if "axes" in tomllib.loads(path.read_text()):
        pytest.skip("a study, not a case")
    case = read_case(path)
    again = parse_case(tomllib.loads(case.to_toml()))
    assert again == case and again.hash == case.hash


def test_round_trip_with_everything() -> None:
    full = merged(impact(6e6, 2.0), {
        "title": "with \"quotes\" and ünïcode",
        "faults.main.initial_stress.shear":
            {"kind": "gaussian", "background": 1e6, "amplitude": 2e6, "center": 0.0, "width": 1e-3},
        "faults.main.friction.L_p": {"kind": "table", "positions": [0.0, 0.1], "values": [1e-5, 2e-5]},
        "boundaries": [{"kind": "absorbing", "edge": "upper.top"}, {"kind": "free", "edge": "lower.left"}],
    })  # fmt: skip
    case = parse_case(full)
    again = parse_case(tomllib.loads(case.to_toml()))
    assert again == case and again.hash == case.hash and again.to_toml() == case.to_toml()


def test_hash_is_of_the_meaning() -> None:
    table = plates()
    same = json.loads(json.dumps(table, sort_keys=True))
    # Order of keys and given defaults change nothing; a number does.
    assert parse_case(table).hash == parse_case(same).hash
    assert parse_case(table).hash == parse_case(merged(table, {"damping": {"mass": 0.0}})).hash
    assert parse_case(table).hash == parse_case(merged(table, {"duration": 5.0e-6})).hash
    seen = {parse_case(table).hash}
    for changes in (
        {"duration": 6e-6}, {"faults.main.friction.mu_d": 0.3}, {"mesh.growth": 1.1}, {"plane": "strain"},
        {"faults.main.contact": {"kind": "split_node"}}, {"output.rupture_threshold": 1.0},
    ):  # fmt: skip
        seen.add(parse_case(merged(table, changes)).hash)
    assert len(seen) == 7


def test_cases_are_frozen() -> None:
    case = parse_case(plates())
    with pytest.raises(CaseError, match=r"case = case\.changed\('duration', 1\.0\)"):
        case.duration = 1.0
    with pytest.raises(CaseError, match=facts(r"changed\('TABLE\.element_size', 1\.0\).*with the dotted key")):
        case.mesh.element_size = 1.0
    assert case.duration == plates()["duration"]


@pytest.mark.parametrize(
    "item, where, value",
    [
        ("duration=60e-6", ["duration"], 60e-6),
        ("faults.main.initial_stress.normal=30e6", ["faults", "main", "initial_stress", "normal"], 30e6),
        ("boundaries.0.velocity = 20.0", ["boundaries", 0, "velocity"], 20.0),
        ("title=a word", ["title"], "a word"),
        ("title='quoted'", ["title"], "quoted"),
        ("plane=strain", ["plane"], "strain"),
        ("output.figures=false", ["output", "figures"], False),
        ("new.table.key=1", ["new", "table", "key"], 1),
        ("faults.main.contact={kind='split_node'}", ["faults", "main", "contact"], {"kind": "split_node"}),
    ],
)
def test_overrides(item: str, where: list[Any], value: Any) -> None:
    table = impact(6e6, 2.0)
    override(table, item)
    for key in where:
        table = table[key]
    assert table == value and type(table) is type(value)


@pytest.mark.parametrize(
    "item, said",
    [
        ("duration", "--set duration: write KEY=VALUE"), ("=3", "--set =3: write KEY=VALUE"),
        ("boundaries.7.velocity=1.0", "boundaries.7.velocity: does not lead to a value"),
        ("boundaries.first.velocity=1.0", "does not lead to a value"),
        ("duration.value=1.0", "does not lead to a value"),
    ],
)  # fmt: skip
def test_bad_overrides(item: str, said: str) -> None:
    with pytest.raises(CaseError, match=facts_of(said)):
        override(impact(6e6, 2.0), item)


def test_overrides_are_checked_like_the_file(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(plates()))
    assert read_case(path, ["duration=7e-6", "materials.default.density=2e3"]).duration == 7e-6
    with pytest.raises(CaseError, match=facts(r"unknown key 'densty', did you mean 'density'")):
        read_case(path, ["materials.default.densty=2e3"])


def test_paths_are_relative_to_the_case_file(tmp_path: Path) -> None:
    mesh = {"kind": "gmsh_file", "file": "some/mesh.msh", "interfaces": {"main": {"plus": "a", "minus": "b"}}}
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(plates({"mesh": mesh})))
    assert read_case(path).mesh.file == str(tmp_path / "some/mesh.msh")


def test_impact_speed_is_the_largest_drive() -> None:
    assert parse_case(plates()).impact_speed == 0
    assert parse_case(impact(6e6, -20.0)).impact_speed == 20


def test_keys_of_a_stepper_without_a_kind_are_of_the_default_one(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(plates()))
    assert read_case(path, ["stepper.time_step=1e-9"]).stepper == Leapfrog(time_step=1e-9)
    assert read_case(path).stepper == Leapfrog()
    with pytest.raises(CaseError, match=facts(r"stepper: unknown key 'time_stp', did you mean 'time_step'\?")):
        read_case(path, ["stepper.time_stp=1e-9"])


def test_cases_and_studies_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "a study.toml").write_text('case = "case.toml"\n[[axes]]\nkey = "duration"\nvalues = [1.0]\n')
    with pytest.raises(CaseError, match=facts(r"a study, not a case; run it with: ruptfx study '.*/a study\.toml'$")):
        read_case(tmp_path / "a study.toml")
    (tmp_path / "case.toml").write_text(tomli_w.dumps(plates()))
    with pytest.raises(
        CaseError, match=facts(r"case\.toml: a case, not a study; run it with: ruptfx run \S*case\.toml$")
    ):
        read_study(tmp_path / "case.toml")


def test_json_schema_is_one() -> None:
    schema = file_schema()
    text = json.dumps(schema)
    # Every reference leads somewhere, every law is offered by its name.
    for reference in {part.split('"')[0] for part in text.split('"$ref": "')[1:]}:
        node: Any = schema
        for key in reference.removeprefix("#/").split("/"):
            node = node[key]
    kinds = {entry["properties"]["kind"]["const"] for entry in schema["$defs"]["friction"]["oneOf"]}
    assert {"coulomb", "prakash_clifton", "rate_and_state_power_law"} <= kinds
    assert set(schema["$defs"]["case"]["required"]) == {"plane", "duration", "mesh", "materials"}


def test_json_schema_accepts_and_refuses() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(file_schema())
    assert validator.is_valid(impact(6e6, 2.0))
    assert validator.is_valid(merged(impact(6e6, 2.0), {"stepper": {"time_step": 1e-9}}))
    assert validator.is_valid(merged(impact(6e6, 2.0), {"stepper": {"kind": "quasi_static", "first_step": 1.0}}))
    assert not validator.is_valid(merged(impact(6e6, 2.0), {"stepper": {"time_stp": 1e-9}}))
    assert not validator.is_valid(merged(impact(6e6, 2.0), {"duratoin": 1.0}))
    receiver = {"kind": "receiver", "interval": 1e-7, "fields": ["velocity"]}
    for keys, valid in (({"stations": "a"}, True), ({"name": "a", "point": [0.0, 1.0]}, True), ({"name": "a"}, False),
                        ({"name": "a", "stations": "a.csv", "pont": [0.0, 1.0]}, False)):  # fmt: skip
        assert validator.is_valid(merged(impact(6e6, 2.0), {"instruments": [receiver | keys]})) == valid, keys
    for path in DEMOS:  # cases of both kinds, and studies
        table = tomllib.loads(path.read_text())
        assert validator.is_valid(table), path
        assert not validator.is_valid({**table, "titel": "x"}), path


def test_the_only_interface_is_that_of_instruments_and_terms() -> None:
    """With another name than `main`; of two interfaces the default is `main`, and a name that is there stays."""
    entries = [{"kind": "fault_receiver", "name": "a", "interval": 1e-7, "position": 1e-3},
               {"kind": "fault_receiver", "name": "b", "interval": 1e-7, "position": 1e-3, "fault": "other"},
               {"kind": "receiver", "name": "c", "interval": 1e-7, "point": [1e-3, 1e-3]}]  # fmt: skip
    table = plates({"instruments": entries, "objective": [{"kind": "final_slip", "target": 1e-6, "sigma": 1e-6}]})
    table["mesh"] = {
        "kind": "gmsh_file",
        "file": "a.msh",
        "interfaces": {name: {"plus": "upper", "minus": "lower"} for name in ("deep", "main")},
    }
    fault = table["faults"].pop("main")
    for names, expected in ((("deep",), "deep"), (("deep", "main"), "main")):
        case = parse_case({**table, "faults": dict.fromkeys(names, fault)})
        assert [each.fault for each in case.instruments[:2]] == [expected, "other"]
        assert case.objective[0].fault == expected
