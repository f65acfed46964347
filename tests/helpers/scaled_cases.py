"""Numbers of cases of all kinds, with bodies and lumped, with their units."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ruptfx.bodies.boundaries.moved import Moved
from ruptfx.case import parse_case
from ruptfx.input.profiles import OfKey, Profile
from ruptfx.input.quantities import _unit
from ruptfx.input.schema import Part, Unit, has_mark, unit_of

Table = dict[str, Any]
Change = Callable[[float, str, bool], object]


def unit_factor(unit: str, factors: dict[str, float]) -> float:
    """Return the factor of a number with a unit where the base units m, s and kg have factors."""
    dimension = {} if unit == "degree" else _unit(unit)[1]
    return float(np.prod([factors.get(base, 1.0) ** power for base, power in dimension.items()]))


def mapped(table: Table, change: Change) -> Table:
    """Return a case with `change(number, unit, text allowed)` in place of every number that has a unit."""
    case = parse_case(table)
    return _mapped(case, table, change, "1")


def _mapped(part: Part, table: Table, change: Change, of_key: str) -> Table:
    result = dict(table)
    for name in type(part).model_fields:
        if name not in table:
            continue
        text = any(has_mark(type(part), name, mark) for mark in (Unit, OfKey))
        inner = isinstance(part, Profile) and name != "factor"  # of which the unit is that of the key
        unit = unit_of(type(part), name)
        if has_mark(type(part), name, OfKey) or (inner and unit == "1" and isinstance(getattr(part, name), Profile)):
            unit = of_key
        if isinstance(part, Profile) and name == "slope":  # change per distance
            unit = f"{of_key}/m"
        if isinstance(part, Moved) and name == "values":
            unit = {"displacement": "m", "velocity": "m/s"}[part.quantity]
        result[name] = _value(getattr(part, name), table[name], change, unit, text)
    return result


def _value(value: Any, plain: Any, change: Change, unit: str, text: bool) -> Any:
    if isinstance(value, Part):
        return _mapped(value, plain, change, unit)
    if isinstance(value, dict):
        return {key: _value(value[key], plain[key], change, unit, text) for key in plain}
    if isinstance(plain, list):
        return [_value(each, item, change, unit, text) for each, item in zip(value, plain, strict=True)]
    if isinstance(plain, float) or (isinstance(plain, int) and not isinstance(plain, bool) and unit != "1"):
        return change(float(plain), unit, text)
    return plain
