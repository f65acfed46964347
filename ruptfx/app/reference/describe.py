"""Text of `ruptfx describe` and of the reference pages: kinds and tables of a case, key by key."""

from __future__ import annotations

import ast
import inspect
import re
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ruptfx import RuptfxError
from ruptfx.bodies.boundaries.histories import Ricker, Sampled
from ruptfx.case import Case, Damping, FaultCase, KelvinVoigt, Output, case_schema
from ruptfx.input.profiles.places import Place
from ruptfx.input.schema import (
    Alternative,
    Part,
    Unit,
    alternatives,
    broken,
    descriptions,
    directory_of,
    first_line,
    from_outside,
    json_schema,
    kinds,
    nearest,
    own_module,
    package_of,
    unit_of,
)
from ruptfx.interfaces.faults.initial_stress import InitialStress
from ruptfx.laws.materials.library import LIBRARY, in_words
from ruptfx.many_runs.study.definition import Axis, Mark, Refine, Study
from ruptfx.many_runs.study.goals import Goal, Search
from ruptfx.results import summary_fields
from ruptfx.stepping.stopping import StopWhen

FOLDERS = (
    "friction", "cohesion", "cracks", "collisions", "nucleation", "slip_histories", "pore_pressure", "temperature",
    "boundaries", "attachments", "contact", "materials", "meshes", "initial_stress", "phases", "steppers", "stop_rules",
    "operators", "instruments", "misfits", "cameras", "profiles", "search_methods", "lumped",
)  # fmt: skip
CLASSES: dict[str, dict[str, type[Part]]] = {
    "profiles": {"a point as center": Place}, "histories": {"ricker": Ricker, "sampled": Sampled},
}  # fmt: skip
"""Kinds that are no files of their own; they come after those of the folder, if there is one."""
TABLES: dict[str, dict[str, type[Part]]] = {
    "case": {"case": Case},
    "faults": {"faults.NAME": FaultCase, "faults.NAME.initial_stress": InitialStress},
    "output": {"output": Output},
    "stop_when": {"stop_when": StopWhen},
    "damping": {"damping": Damping, "damping.kelvin_voigt": KelvinVoigt},
    "study": {
        "study": Study,
        "axes": Axis,
        "refine": Refine,
        "marks": Mark,
        "search": Search,
        "search.goals": Goal,
    },
}
"""Tables of a case or a study that have no kind, by the topic of `ruptfx describe` and by their keys."""
TOPICS = (*TABLES, *FOLDERS, "histories", "summary")


@dataclass(frozen=True)
class Key:
    """Documentation of one key of a table."""

    name: str
    unit: str
    """Unit; empty if the value is not a number."""
    bounds: str
    """Bounds of a number; for alternatives the topic that describes them."""
    default: str
    """Default value, or `required`."""
    description: str


@dataclass(frozen=True)
class Entry:
    """A kind or a table, with its keys."""

    name: str
    summary: str
    details: str
    """Docstring after its first line."""
    labels: dict[str, str]
    """Formula, state, source and so on."""
    keys: list[Key]
    problem: str = ""
    """Reason why it does not load."""


def file_schema() -> dict[str, object]:
    """Return the JSON schema of a file for `ruptfx run` (a case) or `ruptfx study` (a study)."""
    schema, study = case_schema(), json_schema(Study, [package_of("search_methods")])
    schema["title"] = "ruptfx case or study"
    schema["$defs"] |= {**study.pop("$defs"), "study": study}
    schema["oneOf"].append({"$ref": "#/$defs/study"})
    return schema


def entries(topic: str) -> Iterator[Entry]:
    """Yield the entries of a topic; kinds that do not load come last, with the reason.

    Raises
    ------
    RuptfxError
        No such topic.
    """
    if topic not in TOPICS:
        raise RuptfxError(f"describe {topic}: {nearest(topic, list(TOPICS))}")
    if topic == "summary":
        yield Entry("summary.json", "What a run found, in one file.", "", {}, list(_summary_keys()))
    elif topic not in FOLDERS:
        yield from _with_held((TABLES | CLASSES)[topic])
    elif topic == "operators":
        for kind in kinds("ruptfx.bodies.operators"):
            try:
                described = from_outside("ruptfx.bodies.operators", kind) or own_module("ruptfx.bodies.operators", kind)
            except RuptfxError as error:
                yield Entry(kind, "", "", {}, [], str(error))
                continue
            yield Entry(kind, _marked(first_line(described)), _details(described), {}, [])
    else:
        yield from _with_held(alternatives(package_of(topic)) | CLASSES.get(topic, {}))
        if topic == "materials":
            yield _library()
        for kind, reason in broken(package_of(topic)).items():
            yield Entry(kind, "", "", {}, [], reason)


def _library() -> Entry:
    """Return the materials that a case may name."""
    keys = [Key(name, "", "", "", in_words(name)) for name in LIBRARY]
    details = (
        'materials.upper = "pmma" stands for its constants, and a table may replace some of them:\n'
        'materials.upper = { name = "pmma", density = "1180 kg/m3" }. The resolved case contains the numbers.'
    )
    return Entry("by name", "Materials of the library, isotropic elastic.", details, {}, keys)


def entries_of(what: str) -> Iterator[Entry]:
    """Return the entries of a topic, or those of one kind: `coulomb`, or `boundaries.driven` where two folders have it.

    Raises
    ------
    RuptfxError
        No such topic or kind.
    """
    topic, _, kind = what.rpartition(".")
    places = [each for each in TOPICS if each in (*FOLDERS, *CLASSES) and topic in ("", each)]
    if what in TOPICS or not any(kind in names_of(each) for each in places):
        if what not in TOPICS:
            known = [*TOPICS, *(name for each in places for name in names_of(each))]
            raise RuptfxError(f"describe {what}: {nearest(what, known)}")
        yield from entries(what)
        return
    for each in places:
        if kind in names_of(each):
            related = (entry for entry in entries(each) if entry.name == kind or entry.name.startswith(f"{kind}."))
            yield from (replace(entry, name=f"{each}.{entry.name}") for entry in related)


def names_of(topic: str) -> list[str]:
    """Return the kinds of a topic without loading them."""
    return [*(kinds(package_of(topic)) if topic in FOLDERS else ()), *CLASSES.get(topic, {})]


def describe_topic(what: str) -> Iterator[RenderableType]:
    """Return the blocks that the command prints, one per kind or table.

    Raises
    ------
    RuptfxError
        No such topic or kind.
    """
    for entry in entries_of(what):
        if entry.problem:
            yield Panel(Text(entry.problem), title=Text(f"{entry.name} (broken)"), title_align="left", style="red")
            continue
        # Paragraphs are reflowed to the screen; lists, indented lines and sources keep their lines.
        details = re.sub(r"(?<!\n)\n(?![\s-]|Source:)", " ", entry.details)
        text = Text(entry.summary + (f"\n\n{details}" if details else ""))
        grid = Table.grid(padding=(0, 2))
        grid.add_row(text)
        if entry.labels:
            labels = Table.grid(padding=(0, 2))
            for label, value in entry.labels.items():
                labels.add_row(label, Text(value))
            grid.add_row("")
            grid.add_row(labels)
        if entry.keys:
            columns = "key", "unit", "bounds", "default", "what it is"
            table = Table(*columns, box=None, pad_edge=False, header_style="dim")
            for key in entry.keys:
                table.add_row(key.name, key.unit, key.bounds, Text(key.default), Text(key.description))
            grid.add_row("")
            grid.add_row(table)
        yield Panel(grid, title=Text(entry.name), title_align="left")


def about(topic: str) -> str:
    """Return a few words about a topic."""
    if topic in FOLDERS:
        # Read instead of imported: some need DOLFINx to run, but not to be described.
        text = ast.get_docstring(ast.parse(directory_of(topic).joinpath("__init__.py").read_text())) or ""
        return re.split(r", one|:", text)[0]
    if topic in TABLES:
        return first_line(next(iter(TABLES[topic].values()))).rstrip(".")
    return {"histories": "What sources and moved edges follow in time", "summary": "What a run found"}[topic]


def keys_of(cls: type[Part]) -> list[Key]:
    """Return every key of a table except its `kind`."""
    schema, said = cls.model_json_schema()["properties"], descriptions(cls)
    return [
        Key(name, _unit(cls, name), ", ".join(filter(None, (_bounds(field), _elsewhere(cls, schema.get(name, {}))))),
            _default(field), " ".join(_marked(said.get(name, "")).split()))
        for name, field in cls.model_fields.items()
        if name != "kind"
    ]  # fmt: skip


def _elsewhere(cls: type[Part], schema: object) -> str:
    """Return the topics that describe the values of a key, from its JSON schema."""
    topics = {part.__name__: topic for topic, tables in TABLES.items() for part in tables.values() if part is not cls}
    items = [
        name if key == "x-folder" else topics.get(name.rpartition("/")[2], "")
        for key, name in _references(schema)
    ]  # fmt: skip
    others = [f"see {topic}" for topic in dict.fromkeys(items) if topic not in ("", "profiles")]
    return ", ".join(others + ["may be a profile"] * ("profiles" in items))


def _references(schema: object) -> Iterator[tuple[str, str]]:
    """Yield folders of kinds and named tables in a JSON schema, at any depth."""
    if isinstance(schema, dict):
        yield from ((key, str(schema[key])) for key in ("x-folder", "$ref") if key in schema)
    for inner in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from _references(inner)


def _with_held(table: Mapping[str, type[Part]]) -> Iterator[Entry]:
    """Yield each table with the tables that it contains and that appear nowhere else."""
    seen = {cls for group in (*TABLES.values(), *CLASSES.values()) for cls in group.values()} | {Place}
    for name, cls in table.items():
        yield _entry(name, cls)
        todo = [(f"{name}.{key}", field.annotation) for key, field in cls.model_fields.items()]
        while todo:
            where, part = todo.pop(0)
            if not (isinstance(part, type) and issubclass(part, Part)):
                todo += [(where, inner) for inner in typing.get_args(part)]
            elif part not in seen and not issubclass(part, Alternative):
                seen.add(part)
                kind = typing.get_args(part.model_fields["kind"].annotation) if "kind" in part.model_fields else ()
                yield _entry(f"{where}, kind {kind[0]}" if kind else where, part)
                todo += [(f"{where}.{key}", field.annotation) for key, field in part.model_fields.items()]


def _entry(name: str, cls: type[Part]) -> Entry:
    labels = {label: getattr(cls, label) for label in ("formula", "example", "source") if getattr(cls, label, "")}
    state = getattr(cls, "state_fields", None)
    if isinstance(state, dict) and state:  # those of materials depend on their numbers
        labels["state"] = ", ".join(f"{key} [{unit}]" for key, unit in state.items())
    return Entry(name, _marked(first_line(cls)), _details(cls), labels, keys_of(cls))


def _marked(text: str) -> str:
    """Return text with code in single marks, as on the site; docstrings have both."""
    return text.replace("``", "`")


def _details(described: object) -> str:
    """Return the docstring after its first line, without numpydoc sections."""
    text = _marked(inspect.cleandoc(described.__doc__ or "")).partition("\n")[2]
    return text.partition("\nRaises\n")[0].strip("\n")


def _summary_keys() -> Iterator[Key]:
    for name, description in summary_fields.DESCRIPTIONS.items():
        yield Key(name, summary_fields.unit(name), "", "", description)


def _unit(cls: type[Part], name: str) -> str:
    unit = unit_of(cls, name)
    return "" if unit == "1" else unit


def _bounds(field: FieldInfo) -> str:
    """Return `> 0`, `>= 0` ... from the metadata of the field, or of its number if it may vary."""
    items = [*field.metadata]
    for member in typing.get_args(field.annotation):
        items += [item for item in getattr(member, "__metadata__", ()) if not isinstance(item, Unit)]
        for inner in typing.get_args(member):
            for item in getattr(inner, "__metadata__", ()):
                items += getattr(item, "metadata", None) or []
        for item in list(items):
            items += getattr(item, "metadata", None) or []
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    bounds = {
        f"{sign} {getattr(item, key):g}"
        for item in items
        for key, sign in signs.items()
        if getattr(item, key, None) is not None
    }
    if typing.get_origin(field.annotation) is typing.Literal:
        return " | ".join(str(value) for value in typing.get_args(field.annotation))
    return ", ".join(sorted(bounds, key=lambda bound: (bound[0] == "<", bound)))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True, validated_data={})
    if isinstance(default, Alternative):
        return default.kind()
    if isinstance(default, BaseModel) or default is None or default in ({}, [], ""):
        return ""
    if isinstance(default, dict) and default.keys() == {"kind"}:
        return str(default["kind"])
    return in_toml(default)


def in_toml(value: object) -> str:
    """Return a value in the words of a case file; text without its quotes."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {in_toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(in_toml, value)) + "]"
    return str(value)
