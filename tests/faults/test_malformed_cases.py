"""Fuzzing of case and study files: whatever is wrong with one, the answer is an error that names the key."""

from __future__ import annotations

import copy
import datetime
import itertools
import subprocess
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.messages import says
from helpers.small_cases import impact, merged, plates
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from ruptfx import RuptfxError
from ruptfx.case import override, parse_case, read_case
from ruptfx.input.schema import CaseError
from ruptfx.many_runs.study.definition import read_study

DEMOS = Path(__file__).parents[2] / "demos"
TABLES = {path.name: tomllib.loads(path.read_text()) for path in sorted(DEMOS.glob("*.toml"))}
STUDIES = {name: table for name, table in TABLES.items() if "axes" in table}
# What the demos do not use: profiles, nucleation, several edges, a stress tensor, wrappers, a mesh file.
RICH = merged(impact(6e6, 2.0), {
    "faults.main.friction.L_p": {"kind": "table", "positions": [0.0, 0.1], "values": [1e-5, 2e-5]},
    "faults.main.initial_stress.shear":
        {"kind": "random", "mean": 1e6, "standard_deviation": 1e5, "correlation_length": 1e-3, "seed": 1},
    "faults.main.nucleation": [
        {"kind": "overstress",
         "extra": {"kind": "gaussian", "background": 0.0, "amplitude": 1e6, "center": 0.0, "width": 1e-3}},
    ],
    "boundaries": [
        {"kind": "absorbing", "edge": "upper.top"}, {"kind": "traction", "edge": "lower.left", "traction": [1.0, 2.0]},
    ],
    "damping": {"mass": 1.0, "kelvin_voigt": {"fraction": 0.2}},
    "stop_when": {"tip_beyond": 1e-3}, "output": {"checkpoint_steps": 5, "rupture_threshold": 1e-4},
})  # fmt: skip
FILED = plates({
    "mesh": {"kind": "gmsh_file", "file": "plates.msh", "interfaces": {"main": {"plus": "a", "minus": "b"}}},
    "faults.main.initial_stress": {"tensor": [0.0, -6e6, 1e6]},
    "faults.main.friction":
        {"kind": "coulomb", "mu_d": {"kind": "random_classes", "values": [0.1, 0.2], "weights": [1, 2.0], "cell": 1e-3,
                                     "seed": 3}},
})  # fmt: skip
CASES = {name: table for name, table in TABLES.items() if "axes" not in table} | {"rich": RICH, "filed": FILED}

WORDS = st.sampled_from(
    ["", "kind", "x", "coulomb", "duration", "main", "values", "file", "..", "../../etc/passwd", "/dev/null", "a.b",
     "théta", "\x00", "\ud7ff", "😀" * 50, "__class__", "model_fields", "{0}", "%s", "[bold]", "\n", "nan", "<number>"]
) | st.text(max_size=8)  # fmt: skip
NUMBERS = st.sampled_from(
    [0, -1, 1, 2**31, -(2**63), 10**40, 10**400, 0.0, -0.0, 5e-324, 1e-300, 1e300, -1e308, float("nan"), float("inf"),
     -float("inf")]
) | st.integers() | st.floats()  # fmt: skip
DATES = st.sampled_from([datetime.date(2026, 1, 1), datetime.time(1, 2), datetime.datetime(2026, 1, 1, 1)])
VALUES = st.recursive(
    WORDS | NUMBERS | st.booleans() | DATES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every key and every entry of the tables."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [deeper for key, value in items for deeper in [(*path, key), *places(value, (*path, key))]]


@st.composite
def damaged(draw: st.DrawFn, tables: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """A valid table after up to four changes: values, types, nesting, missing and unknown keys, entries moved about."""
    table = copy.deepcopy(tables[draw(st.sampled_from(sorted(tables)))])
    for _ in range(draw(st.integers(1, 4))):
        known = places(table)
        if not known:
            break
        *parents, last = draw(st.sampled_from(known))
        node: Any = table
        for key in parents:
            node = node[key]
        value = node[last]
        change = draw(st.sampled_from(["value", "remove", "wrap", "key", "rename", "scale", "move", "unwrap"]))
        if change == "value":
            node[last] = draw(VALUES)
        elif change == "remove":
            del node[last]
        elif change == "wrap":
            node[last] = draw(st.sampled_from([[value], {"kind": value}, {"a": value}, [value, value], {"": [value]}]))
        elif change == "key" and isinstance(value, dict):
            value[draw(WORDS)] = draw(VALUES)
        elif change == "rename" and isinstance(node, dict):
            node[draw(WORDS)] = node.pop(last)
        elif change == "scale" and isinstance(value, float | int):
            node[last] = draw(st.sampled_from([-1, 1e-30, 1e30, 1e300, 0])) * value
        elif change == "move":
            node[last] = copy.deepcopy(table[draw(st.sampled_from(sorted(table)))]) if table else 0
        elif change == "unwrap" and isinstance(value, list) and value:
            node[last] = value[0]
    return table


def key_is_named(message: str) -> bool:
    """Whether every line begins with a key, not with a sentence about the innards."""
    return all(": " in line and line.partition(": ")[0].strip() for line in message.splitlines())


many = settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.faults
@many
@given(damaged(CASES))
def test_damaged_cases(table):
    try:
        case = parse_case(table, DEMOS)
    except CaseError as error:
        assert key_is_named(str(error))
    else:
        again = parse_case(tomllib.loads(case.to_toml()))
        assert again.hash == case.hash


@pytest.mark.slow
@pytest.mark.faults
@many
@given(damaged(STUDIES))
def test_damaged_studies(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("study") / "study.toml"
    for name, case in CASES.items():
        (path.parent / name).write_text(tomli_w.dumps(case))
    try:
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
    except (TypeError, ValueError):
        reject()  # cannot be written as TOML
    try:
        study = read_study(path)
        points = itertools.islice(study.combinations(), 5)
        [study.point(values) for values in points]
    except CaseError as error:
        assert key_is_named(str(error))


@pytest.mark.faults
@many
@given(st.binary(max_size=40), st.integers(0, 2000), st.integers(0, 30))
def test_damaged_files(tmp_path_factory, junk, where, lost):
    path = tmp_path_factory.mktemp("case") / "case.toml"
    text = (DEMOS / "impact.toml").read_bytes()
    path.write_bytes(text[:where] + junk + text[where + lost :])
    try:
        read_case(path)
    except CaseError as error:
        assert key_is_named(str(error))


@pytest.mark.faults
@many
@given(WORDS, WORDS, VALUES)
def test_damaged_overrides(first, second, value):
    for key in (first, f"{first}.{second}", f"faults.main.{first}", f"boundaries.{second}", f"duration.{first}"):
        table = copy.deepcopy(TABLES["impact.toml"])
        try:
            override(table, f"{key}={value!r}")
            parse_case(table, DEMOS)
        except CaseError as error:
            assert str(error)


IMPACT = (DEMOS / "impact.toml").read_text()


def with_duration(text: str) -> str:
    return IMPACT.replace("duration = 60e-6", text)


# What no reader can hold, or no terminal show.
@pytest.mark.parametrize(
    "text, said",
    [
        (with_duration("duration = 1" + "0" * 5000), "not valid TOML: an integer of more than 4300 digits"),
        (with_duration("duration = 0x1" + "0" * 5000), "duration: an integer of 20001 bits"),
        (with_duration("duration = " + "[" * 5000 + "]" * 5000), "nested too deeply"),
        (with_duration("duration." + ".".join("a" * 3000) + " = 1"), "a key of more than 40 levels"),
        (with_duration("[a" + 50_000 * " . 'a'" + "]"), "a key of more than 40 levels"),
        (with_duration("b = { x." + 50_000 * "a." + "y = 1 }"), "a key of more than 40 levels"),
        (IMPACT + '\n"a\\nb" = 1\n', "unknown key ''a\\nb''"),
        (IMPACT.replace("L_p = 40e-6", 'L_p = { kind = "table", file = "a\\u0000" }'), "embedded null byte"),
        (IMPACT.replace("faults.main", 'faults."../x"'), "a name has a letter first"),
        ("kind = [1]", "kind = '[1]': unknown, known: "),
    ],
    ids=range(10),
)
def test_what_cannot_be_held_is_refused(tmp_path, text, said):
    path = tmp_path / "case.toml"
    path.write_text(text)
    with pytest.raises(CaseError) as caught:
        read_case(path)
    assert says(said, str(caught.value))
    assert len(str(caught.value)) < 2000
    assert all(line.startswith(str(path)) for line in str(caught.value).splitlines())


def test_signature_of_other_editors_is_skipped(tmp_path):
    (tmp_path / "case.toml").write_bytes(b"\xef\xbb\xbf" + IMPACT.replace("\n", "\r\n").encode())
    assert read_case(tmp_path / "case.toml").hash == read_case(DEMOS / "impact.toml").hash


# Numbers of the right type and sign from which no run can be made, or whose preview divides by them.
@pytest.mark.fem
@pytest.mark.parametrize(
    "changes",
    [
        {"mesh.length": 1e300}, {"mesh.height": 1e30}, {"mesh.element_size": 1e-300}, {"mesh.element_size": 1e-7},
        {"mesh.length": 1e-30}, {"mesh.growth": 1 + 1e-15, "mesh.element_size": 1e-30},
        {"faults.main.initial_stress.normal": 0.0}, {"faults.main.friction.mu_d": 0.0},
        {"faults.main.initial_stress.shear": 1e300}, {"materials.default.density": 1e300},
    ],
    ids=str,
)  # fmt: skip
def test_extreme_numbers(changes):
    pytest.importorskip("dolfinx")
    from ruptfx.app.checks.preflight import preflight

    with suppress(RuptfxError), np.errstate(all="ignore"):
        list(preflight(parse_case(plates(changes))))


@pytest.mark.faults
@pytest.mark.parametrize("command", ["run", "check", "study"])
@pytest.mark.parametrize("text", ["plane = 3", '"a\\nb" = [[]]', "x = 1" + "0" * 5000, "\0"], ids=range(4))
def test_command_line_refuses_with_one_message(tmp_path, command, text):
    (tmp_path / "case.toml").write_text(text)
    ruptfx = [sys.executable, "-m", "ruptfx"]
    done = subprocess.run([*ruptfx, command, "case.toml"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    phase, _, message = done.stderr.partition("\n")
    assert phase == "reading case.toml"
    assert message.startswith("case error: ") and "Traceback" not in message
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]


@pytest.mark.faults
@pytest.mark.fem
def test_names_in_a_case_do_not_leave_the_run_directory(tmp_path):
    pytest.importorskip("dolfinx")
    away = "../../away/\u202e.."
    (tmp_path / "here").mkdir()
    table = plates({"title": away, "duration": 2e-7, "output": {"figures": True}})
    (tmp_path / "here" / "case.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "ruptfx", "run", "case.toml", "--out", "runs/one", "--quiet"],
        cwd=tmp_path / "here", capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if "runs/one" not in str(path)} == {
        "here", "here/case.toml", "here/runs",
    }  # fmt: skip
    for name in (away, "/tmp/x", "..", "a/b", "a\\b", ".x", "x\n"):
        with pytest.raises(CaseError, match=r"^case: faults\.|^faults\.|^case: "):
            parse_case({**table, "faults": {name: table["faults"]["main"]}})


@pytest.mark.parametrize("value", [":/tmp/x", "ascii:x.txt", "binary:../x", "draw:/x", "/dev/null", "a b"])
def test_petsc_options_print_but_do_not_write(value):
    slow = {"stepper": {"kind": "quasi_static", "petsc_options": {"snes_view": value}}}
    with pytest.raises(CaseError, match=r"stepper\.petsc_options\.snes_view"):
        parse_case(plates(slow))
    slow["stepper"]["petsc_options"] = {"snes_view": "::ascii_info_detail", "snes_rtol": 1e-9, "snes_monitor": True}
    parse_case(plates(slow))
