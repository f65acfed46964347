"""`ruptfx export-law`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx.app.commands._shared import Overwrite, completed_from, reported, screen, writing

HEADING = "Verify and extend"


def _languages() -> list[str]:
    from ruptfx.app.export_law import languages

    return languages()


def export_law(
    law: Annotated[
        str,
        typer.Argument(help="Kind of friction, Python file with a law, or case (TOML).", show_default=False),
    ],
    to: Annotated[
        str,
        typer.Option(help="Language: c, fortran or python.", autocompletion=completed_from(_languages)),
    ] = "c",
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="<key=value>", help="Value of a parameter, e.g. mu_s=0.6; repeatable."),
    ] = None,
    fault: Annotated[str | None, typer.Option(help="Of several faults of a case, the one whose law it is.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the files.")] = Path("."),
    overwrite: Overwrite = False,
) -> None:
    """Write a friction law as source code for other programs, with a test of its numbers.

    c: header and functions. fortran: a module, and the subroutine VFRICTION of Abaqus/Explicit. python: one file that
    needs NumPy. The files are written from the formula that runs here.

    Example: ruptfx export-law rate_and_state_ageing --to fortran --set a=0.01 --set b=0.015
    """
    with reported():
        from ruptfx.app.export_law import exported, files_of, law_of

        texts = files_of(exported(law_of(law, set_ or [], fault)), to)
        with writing(out, overwrite=overwrite) as files:
            for name, text in texts.items():
                files.claim(name).write_text(text, encoding="utf-8")
        for name in texts:
            screen.print(str(out / name), soft_wrap=True)
