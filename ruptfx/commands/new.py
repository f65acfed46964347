"""`ruptfx new`."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Annotated

import typer

import ruptfx
from ruptfx import RuptfxError
from ruptfx.commands._shared import completed_from, reported, screen

DEMOS = Path(ruptfx.__file__).with_name("demos")


def cases() -> list[str]:
    """Return the demos that are cases, not studies."""
    from ruptfx.case import read_toml

    return sorted(path.stem for path in DEMOS.glob("*.toml") if "axes" not in read_toml(path))


def new(
    name: Annotated[Path, typer.Argument(help="Name of the case; NAME.toml is written.", show_default=False)],
    from_: Annotated[
        str,
        typer.Option(
            "--from", help="A demo: impact, antiplane, bimaterial, gmsh ...; a wrong name lists them.",
            autocompletion=completed_from(cases),
        ),
    ] = "impact",
) -> None:
    """Write a commented, runnable case as a template for your own.

    Example: ruptfx new mine --from bimaterial
    """
    from ruptfx.schema import nearest

    with reported():
        known = cases()
        if from_ not in known:
            raise RuptfxError(f"--from {from_}: {nearest(from_, known)}")
        source = DEMOS / f"{from_}.toml"
        case = name if name.suffix == ".toml" else Path(f"{name}.toml")
        files = [DEMOS / file for file in re.findall(r'^file = "([^"]+)"', source.read_text(), re.MULTILINE)]
        taken = [path for path in (case, *(case.parent / file.name for file in files)) if path.exists()]
        if taken:
            raise RuptfxError(f"{taken[0]}: exists already; choose another name, or remove it")
        case.parent.mkdir(parents=True, exist_ok=True)
        text = source.read_text().replace(f"demos/{from_}.toml", str(case))
        case.write_text(text)
        for file in files:
            shutil.copy(file, case.parent)
        screen.print(f"{case}: try  ruptfx check {case}", soft_wrap=True)

