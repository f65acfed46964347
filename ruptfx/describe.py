"""What `ruptfx describe` prints: every alternative of a folder with its fields, units, formula and source."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from typing import Any

from pydantic.fields import FieldInfo
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ruptfx import RuptfxError, profiles
from ruptfx.case import case_schema
from ruptfx.schema import (
    Alternative,
    Part,
    Unit,
    alternatives,
    broken,
    first_line,
    from_outside,
    kinds,
    nearest,
    own_module,
    unit_of,
)
from ruptfx.study.definition import Study

FOLDERS = (
    "friction", "nucleation", "boundaries", "contact", "materials", "meshes", "steppers", "operators", "profiles",
    "lumped",
)  # fmt: skip


def file_schema() -> dict[str, Any]:
    """JSON schema of a file for `ruptfx run` (a case) or `ruptfx study` (a study)."""
    schema, study = case_schema(), Study.model_json_schema()
    schema["title"] = "ruptfx case or study"
    schema["$defs"] |= {**study.pop("$defs"), "study": study}
    schema["oneOf"].append({"$ref": "#/$defs/study"})
    return schema


def describe_folder(name: str) -> Iterator[Any]:
    """Rich renderables, one per alternative; those that do not load come last, with the reason.

    Raises
    ------
    RuptfxError
        No such folder.
    """
    if name not in FOLDERS:
        raise RuptfxError(f"describe {name}: {nearest(name, list(FOLDERS))}")
    if name == "profiles":
        for kind, cls in profiles.KINDS.items():
            yield _panel(kind, cls)
    elif name == "operators":
        for kind in kinds("ruptfx.operators"):
            try:
                described = from_outside("ruptfx.operators", kind) or own_module("ruptfx.operators", kind)
            except RuptfxError as error:
                yield _broken(kind, str(error))
                continue
            yield Panel(first_line(described), title=Text(kind), title_align="left")
    else:
        for kind, cls in alternatives(f"ruptfx.{name}").items():
            yield _panel(kind, cls)
        for kind, reason in broken(f"ruptfx.{name}").items():
            yield _broken(kind, reason)


def _broken(kind: str, reason: str) -> Panel:
    return Panel(Text(reason), title=Text(f"{kind} (broken)"), title_align="left", style="red")


def _panel(kind: str, cls: type[Part]) -> Panel:
    grid = Table.grid(padding=(0, 2))
    grid.add_row("", first_line(cls))
    for label in ("formula", "example", "source"):
        if getattr(cls, label, ""):
            grid.add_row(label, getattr(cls, label))
    if getattr(cls, "state_fields", None):
        grid.add_row("state", ", ".join(f"{key} [{unit}]" for key, unit in cls.state_fields.items()))  # type: ignore[attr-defined]
    for key, field in cls.model_fields.items():
        if key != "kind":
            unit = unit_of(cls, key)
            grid.add_row(key, f"{'' if unit == '1' else unit}  {_bounds(field)}{_default(field)}".strip())
    return Panel(grid, title=Text(kind), title_align="left")


def _bounds(field: FieldInfo) -> str:
    """`> 0`, `>= 0` ... from the metadata of the field or of its number when it may vary."""
    found = [*field.metadata]
    for member in typing.get_args(field.annotation):
        found += [item for item in getattr(member, "__metadata__", ()) if not isinstance(item, Unit)]
        for inner in typing.get_args(member):
            for item in getattr(inner, "__metadata__", ()):
                found += getattr(item, "metadata", None) or []
        for item in list(found):
            found += getattr(item, "metadata", None) or []
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    bounds = {
        f"{sign} {getattr(item, key):g}"
        for item in found
        for key, sign in signs.items()
        if getattr(item, key, None) is not None
    }
    return ", ".join(sorted(bounds))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "  required"
    default = field.default
    return f"  default {default.kind() if isinstance(default, Alternative) else default}"
