"""`ruptfx new`."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Annotated

import typer

import ruptfx
from ruptfx import RuptfxError
from ruptfx.app.commands._shared import completed_from, reported, screen, writing

HEADING = "Begin"

DEMOS = Path(ruptfx.__file__).with_name("demos")


SCHEMA = "ruptfx.input.schema.json"
SCHEMA_LINE = f"#:schema ./{SCHEMA}\n"
"""First line of a case: the schema in its directory, as Taplo and the editors that use it read it."""


def write_schema(folder: Path) -> None:
    """Write the JSON schema of cases and studies of this version into a directory, also over an older one."""
    from ruptfx.app.reference.describe import file_schema

    (folder / SCHEMA).write_text(json.dumps(file_schema()))


def cases() -> list[str]:
    """Return the demos that are cases, not studies."""
    studies = re.compile(r"^\[\[axes\]\]", re.MULTILINE)  # found without reading the numbers of 50 files
    return sorted(path.stem for path in DEMOS.glob("*.toml") if not studies.search(path.read_text(encoding="utf-8")))


def new(
    name: Annotated[Path, typer.Argument(help="Name of the case; NAME.toml is written.", show_default=False)],
    from_: Annotated[
        str,
        typer.Option(
            "--from",
            help="A demo: impact, antiplane, bimaterial, gmsh ...; an unknown name prints the list.",
            autocompletion=completed_from(cases),
        ),
    ] = "impact",
    materials: Annotated[
        str | None,
        typer.Option(help="Material of all bodies, or one for each from top to bottom: pmma,aluminium."),
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="With ruptfx.input.schema.json beside it: editors complete and check keys.")
    ] = False,
) -> None:
    """Write a commented, runnable case as a template for your own.

    With --schema the first line names a JSON schema, for editors that use Taplo, as Even Better TOML of VS Code.

    Example: ruptfx new mine --from bimaterial --materials pmma,aluminium
    """
    from ruptfx.input.schema import nearest

    with reported():
        known = cases()
        if from_ not in known:
            raise RuptfxError(f"--from {from_}: {nearest(from_, known)}")
        source = DEMOS / f"{from_}.toml"
        case = name if name.suffix == ".toml" else Path(f"{name}.toml")
        files = [DEMOS / file for file in dict.fromkeys(re.findall(r'\bfile = "([^"]+)"', source.read_text()))]
        items = [path for path in (case, *(case.parent / file.name for file in files)) if os.path.lexists(path)]
        if items:
            raise RuptfxError(f"{items[0]}: exists already; choose another name, or remove it")
        text = source.read_text().replace(f"demos/{from_}.toml", str(case))
        if materials is not None:
            text = with_materials(text, materials.replace(",", " ").split(), from_)
        with writing(case.parent) as written:
            if schema:
                text = SCHEMA_LINE + text
                written.claim(SCHEMA)
                write_schema(written.place)
            (written.place / case.name).write_text(text, encoding="utf-8")
            for file in files:
                shutil.copy(file, written.place)
        screen.print(f"{case}: try  ruptfx check {case}", soft_wrap=True)


def with_materials(text: str, names: list[str], demo: str) -> str:
    """Return the text of a case with materials of the library instead of its own.

    Raises
    ------
    RuptfxError
        An unknown material, a demo without materials, or more materials than bodies.
    """
    from ruptfx.input.schema import load_toml, nearest
    from ruptfx.laws.materials.library import LIBRARY, in_words

    for name in names:
        if name not in LIBRARY:
            raise RuptfxError(f"--materials {name}: {nearest(name, list(LIBRARY))}")
    tables = load_toml(text)
    materials = tables.get("materials")
    if not isinstance(materials, dict):
        raise RuptfxError(f"--materials: the demo {demo} has no bodies with materials")
    bodies = {"two_plates": ("upper", "lower")}.get(tables["mesh"]["kind"], tuple(materials))
    if len(names) == 1:
        chosen = [("default", names[0])]
    elif len(names) == len(bodies):
        chosen = list(zip(bodies, names, strict=True))
    else:
        raise RuptfxError(f"--materials: give one for all bodies, or one for each of {', '.join(bodies)}")
    lines = ["[materials]"]
    for body, name in chosen:
        lines.append(f'{body} = "{name}"'.ljust(34) + f" # {in_words(name)}")
    first = re.search(r"^\[materials\b", text, re.MULTILINE)
    assert first is not None
    # A table ends where the next one begins; comments directly above a table belong to it.
    without = re.sub(r"^\[materials\.[^\]]+\][^\n]*\n(?:(?!\[|#).*\n)*", "", text, flags=re.MULTILINE)
    changed = without[: first.start()] + "\n".join(lines) + "\n\n" + without[first.start() :]
    load_toml(changed)
    return changed
