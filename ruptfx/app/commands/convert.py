"""`ruptfx convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import reported, screen, writing

HEADING = "Begin"


def convert(
    file: Annotated[Path, typer.Argument(help="Input of SEM2DPACK, mostly Par.inp.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="Case file to write; default NAME.toml beside it.")] = None,
    without: Annotated[
        list[str] | None, typer.Option(help="Name of a refused feature to leave out; repeatable.", show_default=False)
    ] = None,
) -> None:
    """Write the case of a SEM2DPACK input, and its mesh where ruptfx has no kind for it.

    Example: ruptfx convert Par.inp --out fault.toml --without GENERAL.W
    """
    with reported():
        from ruptfx.app.convert.sem2dpack import convert_file
        from ruptfx.case import parse_case
        from ruptfx.input.schema import load_toml

        case = out or file.with_suffix(".toml")
        mesh = case.with_suffix(".msh")
        result = convert_file(file, mesh.name, without or ())
        for path in (case, mesh) if result.mesh else (case,):
            if path.exists():
                raise RuptfxError(f"{path}: exists already; choose another --out, or remove it")
        parse_case(load_toml(result.text))
        with writing(case.parent, [file]) as files:
            (files.place / case.name).write_text(result.text, encoding="utf-8")
            if result.mesh:
                (files.place / mesh.name).write_text(result.mesh, encoding="utf-8")
        for note in result.notes:
            screen.print(note, markup=False, highlight=False, soft_wrap=True)
        screen.print(f"{case}: try  ruptfx check {case}", soft_wrap=True)
