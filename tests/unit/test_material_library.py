"""Materials by name: constants, replaced ones, errors, and what `describe` and the JSON schema say."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Any

import pytest
from helpers.messages import facts
from helpers.small_cases import case, plates

from ruptfx.app.reference.describe import entries
from ruptfx.case import case_schema, parse_case
from ruptfx.input.quantities import factor
from ruptfx.input.schema import CaseError
from ruptfx.laws.materials import library as _library
from ruptfx.laws.materials.library import LIBRARY, in_words

SPEEDS = {  # c_p and c_s in plane strain [m/s], within 1 %, from the constants by hand
    "homalite": (2613.0, 1255.0), "pmma": (2700.0, 1345.0), "polycarbonate": (1967.0, 865.4),
    "aluminium": (6149.0, 3098.0), "steel": (5960.0, 3235.0), "granite": (5250.0, 2900.0),
}  # fmt: skip


def material(given: Any) -> Any:
    table = plates()
    table["materials"] = {"default": given}
    return parse_case(table).materials["default"]


@pytest.mark.parametrize("name", LIBRARY)
def test_a_name_stands_for_constants_with_a_source(name: str) -> None:
    found = material(name)
    speeds = found.wave_speeds("strain")
    assert (speeds.c_p, speeds.c_s) == pytest.approx(SPEEDS[name], rel=0.01)
    assert f"\n- {name}: " in _library.__doc__, "say where the constants are from"
    assert set(LIBRARY[name].typical) <= set(LIBRARY[name].constants)
    assert in_words(name).count("(typical)") == len(LIBRARY[name].typical)
    printed = re.findall(r"\w+ ([\d.]+)(?: ([^,; (]+))?(?: \(typical\))?[,;]", in_words(name))
    numbers = [factor(unit or "1", None) * Fraction(value) for value, unit in printed]
    assert [float(number) for number in numbers] == pytest.approx([*LIBRARY[name].constants.values()])


def test_a_table_replaces_constants() -> None:
    found = material({"name": "steel", "density": "7900 kg/m3"})
    assert found.density == 7900.0 and found.wave_speeds("strain").c_s == pytest.approx(3235.0)
    assert material({"name": "polycarbonate", "fringe_constant": 6.6e3}).fringe_constant == 6.6e3


def test_the_resolved_case_has_numbers_and_equals_one_with_them() -> None:
    by_name = case({"materials.default": "homalite"})
    constants = LIBRARY["homalite"].constants
    assert by_name.hash == case({"materials.default": {"kind": "isotropic_elastic", **constants}}).hash
    assert by_name.table()["materials"]["default"]["density"] == 1246.0


@pytest.mark.parametrize(
    "given, words",
    [("pmna", "did you mean 'pmma'"), ("wood", "known: aluminium, granite"), ({"name": "wood"}, "known: aluminium"),
     ({"name": "pmma", "young_modulus": 3e9}, "give either c_p and c_s or young_modulus"),
     ({"name": "pmma", "densty": 1.0}, "did you mean 'density'")],
)  # fmt: skip
def test_errors(given: Any, words: str) -> None:
    with pytest.raises(CaseError, match=facts(words)) as error:
        material(given)
    assert str(error.value).startswith("materials.default")


def test_describe_and_schema_know_the_names() -> None:
    assert [key.name for key in list(entries("materials"))[-1].keys] == list(LIBRARY)
    (values,) = case_schema()["$defs"]["case"]["properties"]["materials"]["patternProperties"].values()
    choices = values["anyOf"]
    assert choices[0] == {"$ref": "#/$defs/materials"} and choices[1] == {"enum": list(LIBRARY)}
