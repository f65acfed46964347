"""Valid examples of any part of a case, made from its field types, so that a new file needs no edit in the tests."""

from __future__ import annotations

import copy
import tomllib
import zlib
from collections.abc import Callable
from functools import cache

import numpy as np
from pydantic import ValidationError

from ruptfx import Table
from ruptfx.input.schema import Alternative, CaseError, Part, alternatives, home, package_of, unit_of

Array = np.ndarray

# Decades of random values of a field, by its unit.
DECADES = {
    "1": (-1.0, 0.0), "m": (-5.0, -3.0), "m/s": (-2.0, 1.0), "s": (-5.0, -2.0), "Pa": (5.0, 8.0), "Pa/m": (10.0, 12.0),
    "1/s": (0.0, 3.0), "kg/m3": (3.0, 3.7),
}  # fmt: skip


def number(seed: int, name: str, unit: str, schema: Table) -> float:
    """Return a number within the bounds of a field, reproducible for a seed and name."""
    random = np.random.default_rng([seed, zlib.crc32(name.encode())])
    value = float(10 ** random.uniform(*DECADES.get(unit, (-1.0, 0.0))))
    above = max(schema.get("minimum", -np.inf), schema.get("exclusiveMinimum", -np.inf))
    below = min(schema.get("maximum", np.inf), schema.get("exclusiveMaximum", np.inf))
    if above < value < below:
        return value
    return 0.5 * (above + below) if np.isfinite(above + below) else (2 * above + 1 if np.isfinite(above) else below - 1)


@cache
def properties(cls: type[Part]) -> dict[str, Table]:
    """Return the JSON schema of every field."""
    return cls.model_json_schema()["properties"]


def choices(schema: Table) -> list[Table]:
    """Return the alternatives of a schema."""
    return schema.get("anyOf") or schema.get("oneOf") or [schema]


def folder(schema: Table) -> str | None:
    """Return the folder of alternatives of a field; None for a number, which may be a profile instead."""
    match = next((item["x-folder"] for item in choices(schema) if "x-folder" in item), None)
    return None if match == "profiles" else match


def flat(schema: Table) -> list[Table]:
    """Return nested alternatives in one list."""
    inner = choices(schema)
    return [schema] if inner == [schema] else [item for entry in inner for item in flat(entry)]


def required_part(cls: type[Part], name: str) -> type[Part] | None:
    """Return the class of the table that a required field must be; None for other fields."""
    field = cls.model_fields[name]
    inside = field.annotation
    return inside if field.is_required() and isinstance(inside, type) and issubclass(inside, Part) else None


def declared(cls: type[Part], seed: int) -> Table:
    """Return the numbers of the example that a law or material declares, those of one unit times one random factor.

    Formulas that are sound for the example stay so, if they have no scale of their own; numbers without unit are kept.
    """
    if not issubclass(cls, Alternative) or not (cls.example and str(home(cls)).startswith("ruptfx.laws.")):
        return {}
    values: Table = tomllib.loads(f"example = {cls.example}")["example"]
    for name, value in values.items():
        unit = unit_of(cls, name) if name in cls.model_fields else "1"
        if isinstance(value, float) and unit != "1":
            factor = np.random.default_rng([seed, zlib.crc32(unit.encode())]).uniform(0.5, 2.0) if seed else 1.0
            values[name] = value * float(factor)
    return values


def table(cls: type[Part], seed: int = 0, law: str | None = None, profiles: bool = False) -> Table:  # noqa: C901
    """Return a table of a case with a value for every field.

    Parameters
    ----------
    seed : int
        Other numbers for other seeds.
    law : str, optional
        Kind of the alternative inside a wrapper.
    profiles : bool
        Give every field that may vary along an interface as a profile.
    """
    result: Table = {}
    known_values = declared(cls, seed)
    for name, schema in properties(cls).items():
        if name not in cls.model_fields:  # an alternative key of another field
            continue
        if known_values and name not in known_values:  # a number of its own might not fit those of the example
            continue
        inner = folder(schema)
        options = flat(schema)
        if inner is not None:
            known = {kind: c for kind, c in alternatives(package_of(inner)).items() if not holds(c)}
            kind = law or min(known)
            result[name] = {"kind": kind, **table(known[kind], seed, None, profiles)}
        elif any(item.get("type") == "number" for item in options):
            limits = next(item for item in options if item.get("type") == "number")
            drawn = number(seed, name, unit_of(cls, name), limits)
            result[name] = value = float(known_values.get(name, drawn))
            if profiles and any(item.get("x-folder") == "profiles" for item in options):
                # Some fields grow where others fall, so that their ratios vary too.
                amplitude = (0.3 if zlib.crc32(name.encode()) % 2 else -0.3) * value
                profile = {"background": value, "amplitude": amplitude, "center": 0.4, "width": 0.2}
                result[name] = {"kind": "gaussian", **profile}
        elif name in known_values:
            result[name] = known_values[name]
        elif any(item.get("type") == "boolean" for item in options):
            result[name] = bool(seed % 2)
        elif any(item.get("type") == "array" and "minItems" in item for item in options):
            array = next(item for item in options if "minItems" in item)
            items = next((item for item in flat(array.get("items", {})) if item.get("type") == "number"), {})
            positive = items.get("exclusiveMinimum", -1) >= 0
            first = number(seed, name, unit_of(cls, name), items) if positive else 0.0
            result[name] = [first] * array["minItems"]
        elif "const" in schema:
            result[name] = schema["const"]
        elif any("enum" in item for item in options):
            result[name] = next(item["enum"][0] for item in options if "enum" in item)
        elif "default" not in schema and any(item.get("type") == "integer" for item in options):
            limits = next(item for item in options if item.get("type") == "integer")
            least = max(limits.get("minimum", 0), limits.get("exclusiveMinimum", -1) + 1)
            result[name] = min(max(1000, least), limits.get("maximum", 1000), limits.get("exclusiveMaximum", 1001) - 1)
        elif (inside := required_part(cls, name)) is not None:
            result[name] = table(inside, seed)
        elif "default" not in schema:
            raise NotImplementedError(f"{cls.__name__}.{name}: examples.py knows no value for {schema}")
    return result


def tables(cls: type[Part], count: int, change: Callable[[Table], object]) -> list[Table]:
    """Return tables with other numbers each that a class accepts after a change; without any, the first ones."""
    first, result = [], []
    for seed in range(200):
        values = table(cls, seed)
        change(values)
        first.append(values)
        try:
            cls.model_validate(copy.deepcopy(values))
        except (CaseError, ValidationError):
            continue
        result.append(values)
        if len(result) == count:
            return result
    return first[:count]


def material(kind: str, plain: bool = False) -> Part:
    """Return an example material, with the first random numbers that it accepts.

    Parameters
    ----------
    plain : bool
        Set only fields without a default.
    """
    cls = alternatives("ruptfx.laws.materials")[kind]
    for seed in range(1000):
        values = table(cls, seed)
        chosen = {name: value for name, value in values.items() if not plain or cls.model_fields[name].is_required()}
        try:
            return cls.model_validate(chosen)
        except (CaseError, ValidationError):
            continue
    raise NotImplementedError(f"examples.py finds no numbers that '{kind}' accepts")


def holds(cls: type[Part]) -> bool:
    """Return whether an alternative wraps another one."""
    return any(folder(schema) for schema in properties(cls).values())


def friction(kind: str, law: str | None = None, seed: int = 0, profiles: bool = False) -> Part:
    """Return an example law."""
    cls = alternatives("ruptfx.laws.friction")[kind]
    return cls.model_validate(table(cls, seed, law, profiles))
