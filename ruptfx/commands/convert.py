"""`ruptfx convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen


def convert(
    file: Annotated[Path, typer.Argument(help="Input of SEM2DPACK, mostly Par.inp.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="Case file to write; default NAME.toml beside it.")] = None,
) -> None:
    """Write the case of a simple SEM2DPACK input: a Cartesian box with a slip-weakening fault.

    Example: ruptfx convert Par.inp --out fault.toml
    """
    with reported():
        import tomllib

        from ruptfx.case import parse_case
        from ruptfx.sem2dpack import convert_file

        text = convert_file(file)
        case = out or file.with_suffix(".toml")
        if case.exists():
            raise RuptfxError(f"{case}: exists already; choose another --out, or remove it")
        parse_case(tomllib.loads(text))
        case.write_text(text, encoding="utf-8")
        for line in text.splitlines():
            if line.startswith("# - "):
                screen.print(line[4:], markup=False, highlight=False, soft_wrap=True)
        screen.print(f"{case}: try  ruptfx check {case}", soft_wrap=True)
