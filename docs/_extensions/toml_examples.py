"""Examples of kinds as TOML: from `docs/reference/examples.toml`, from the demo cases, or declared by the kind.

A kind without any has its required keys, with values made from their types.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from ruptfx import Table
from ruptfx.app.check_law.examples import tables
from ruptfx.app.reference.describe import Entry
from ruptfx.input.schema import Part, alternatives, package_of

ROOT = Path(__file__).parents[2]
WRITTEN = ROOT / "docs" / "reference" / "examples.toml"
TABLES = {
    "friction": r"faults\.\w+\.friction(\.law)?", "cohesion": r"(faults\.\w+|fracture\.default)\.cohesion",
    "contact": r"faults\.\w+\.contact", "cracks": "fracture", "collisions": "collisions",
    "nucleation": r"faults\.\w+\.nucleation", "boundaries": "boundaries", "attachments": "attachments",
    "materials": r"materials\.\w+", "meshes": "mesh", "phases": r"mesh\.phases", "steppers": "stepper",
    "instruments": "instruments", "misfits": "objective", "cameras": "cameras",
    "initial_stress": "initial_stress", "histories": r"boundaries\.history",
}  # fmt: skip
"""Names of the tables of a case in which a kind of a topic stands."""
DECLARED = {
    "boundaries": "[[boundaries]]", "attachments": "[[attachments]]", "instruments": "[[instruments]]",
    "misfits": "[[objective]]", "cameras": "[[cameras]]",
    "meshes": "[mesh]", "initial_stress": "[initial_stress]", "phases": "[mesh.phases]",
    "friction": "[faults.main.friction]", "cohesion": "[faults.main.cohesion]", "contact": "[faults.main.contact]",
    "nucleation": "[[faults.main.nucleation]]", "materials": "[materials.default]", "steppers": "[stepper]",
    "cracks": "[fracture]", "stop_rules": "[[stop_when.rules]]", "search_methods": "[search.method]",
    "pore_pressure": "[[faults.main.pore_pressure]]", "temperature": "[[faults.main.temperature]]",
    "slip_histories": "[[faults.main.prescribed_slip]]",
}  # fmt: skip
"""Headings of the tables that kinds declare, or that are made from their types."""
HEADER = re.compile(r"^\[{1,2}([\w.\"-]+)\]{1,2}", re.MULTILINE)
SHORT, LONGEST = 350, 900  # characters: of examples the longest short one is shown


def example(topic: str, entry: Entry) -> tuple[str, str]:
    """Return an example of a kind and the demo it is from; empty where there is none."""
    written = _written().get(topic, {}).get(entry.name)
    if written:
        return written.strip() + "\n", ""
    found = sorted(_in_demos(topic, entry.name), key=lambda each: len(each[0]))
    found = [each for each in found if ".csv" not in each[0]] or found  # whole without a second file
    short = [each for each in found if len(each[0]) < SHORT]
    if short:
        return short[-1]
    if found and (len(found[0][0]) < LONGEST or topic == "lumped"):
        return found[0]
    declared = entry.labels.get("example", "")
    if topic == "operators":
        return f'operator = "{entry.name}"\n', ""
    if topic not in DECLARED:
        key = "[faults.main.friction]\nmu_s = " if topic == "profiles" else ""
        return f"{key}{declared}\n" if declared else "", ""
    if declared:
        table = tomllib.loads(f"table = {declared}")["table"]
    elif (cls := alternatives(package_of(topic)).get(entry.name)) is not None:
        table = {"kind": entry.name, **_made(cls)}
    else:
        return "", ""
    return "\n".join([DECLARED[topic], *(f"{key} = {as_toml(value)}" for key, value in table.items())]) + "\n", ""


def _made(cls: type[Part]) -> Table:
    """Return the required keys of a kind with numbers of two digits that it accepts."""

    def rounded(value: object) -> object:
        if isinstance(value, dict):
            return {name: rounded(inner) for name, inner in value.items()}
        return float(f"{value:.2g}") if isinstance(value, float) else value

    def shorten(values: Table) -> None:
        for name in list(values):
            value = rounded(values.pop(name))
            if cls.model_fields[name].is_required():
                values[name] = value

    return tables(cls, 1, shorten)[0]


def as_toml(value: object) -> str:
    """Return a value in one line of TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {as_toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, float):
        return f"{value:g}" if "." in f"{value:g}" or "e" in f"{value:g}" else f"{value:.1f}"
    return json.dumps(value)


@cache
def _written() -> dict[str, dict[str, str]]:
    return tomllib.loads(WRITTEN.read_text(encoding="utf-8"))


@cache
def _cases() -> dict[str, str]:
    """Return the text of every demo that is a case, not a study."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "demos").glob("*.toml"))}
    return {name: text for name, text in texts.items() if "case" not in tomllib.loads(text)}


def _in_demos(topic: str, kind: str) -> Iterator[tuple[str, str]]:
    """Yield the tables of demos that are of a kind, with the tables inside of them; of lumped models the whole demo."""
    for name, text in _cases().items():
        if topic == "lumped":
            if tomllib.loads(text).get("kind") == kind:
                yield text.strip() + "\n", name
            continue
        if topic not in TABLES:
            continue
        starts = [*HEADER.finditer(text)]
        ends = [*(each.start() for each in starts[1:]), len(text)]
        for number, start in enumerate(starts):
            if not re.fullmatch(TABLES[topic], start[1]):
                continue
            own = text[start.start() : ends[number]]
            if not re.search(rf'^kind = "{kind}"', own, re.MULTILINE):
                continue
            last = number
            while last + 1 < len(starts) and starts[last + 1][1].startswith(f"{start[1]}."):
                last += 1
            # Comments before the next table belong to it.
            yield re.sub(r"(\n\s*|\n#[^\n]*)+\Z", "\n", text[start.start() : ends[last]]), name
