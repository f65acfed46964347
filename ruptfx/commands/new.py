"""`ruptfx new`."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Annotated

import typer

import ruptfx
from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen


def new(
    name: Annotated[Path, typer.Argument(help="Name of the case; NAME.toml is written.", show_default=False)],
    from_: Annotated[str, typer.Option("--from", help="A demo: impact, antiplane, bimaterial, gmsh ...")] = "impact",
) -> None:
    """Write a commented case that runs, to begin your own from."""
    from ruptfx.schema import nearest

    with reported():
        demos = Path(ruptfx.__file__).with_name("demos")
        known = [path.stem for path in demos.glob("*.toml") if "axes" not in _tables(path)]
        if from_ not in known:
            raise RuptfxError(f"--from {from_}: {nearest(from_, known)}")
        source = demos / f"{from_}.toml"
        case = name.with_suffix(".toml") if name.suffix != ".toml" else name
        files = [demos / file for file in re.findall(r'^file = "([^"]+)"', source.read_text(), re.MULTILINE)]
        taken = [path for path in (case, *(case.parent / file.name for file in files)) if path.exists()]
        if taken:
            raise RuptfxError(f"{taken[0]}: exists already; choose another name, or remove it")
        case.parent.mkdir(parents=True, exist_ok=True)
        text = source.read_text().replace(f"demos/{from_}.toml", str(case))
        case.write_text(text)
        for file in files:
            shutil.copy(file, case.parent)
        screen.print(f"{case}: try  ruptfx check {case}", soft_wrap=True)


def _tables(path: Path) -> dict[str, object]:
    from ruptfx.case import read_toml

    return read_toml(path)
