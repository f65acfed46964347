"""`ruptfx check-law`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from ruptfx.app.commands._shared import EXIT_ERROR, Overwrite, reported, screen, writing

HEADING = "Verify and extend"


def check_law(
    law: Annotated[
        str,
        typer.Argument(
            help="Python file with friction laws, cohesive laws or materials, or a kind.", show_default=False
        ),
    ],
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="<key=value>", help="Value of a parameter, e.g. mu_s=0.6; repeatable."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the pictures.")] = Path("."),
    overwrite: Overwrite = False,
) -> None:
    """Check that a law or material satisfies its contract, and draw it; exit non-zero if a check fails.

    Example: ruptfx check-law my_law.py --set mu_s=0.6 --set L=20e-6
    """
    with reported():
        from ruptfx.app.check_law import check_law as check
        from ruptfx.app.check_law import save_figure
        from ruptfx.app.reference.describe import in_toml

        sound = True
        for report in check(law, set_ or []):
            kind, sound = report.law.kind(), sound and report.sound
            table = Table("check", "verdict", "note", title=f"{report.name} {kind}", title_justify="left")
            for row in report.rows:
                colour = {"failed": "red", "missing": "yellow"}.get(row.verdict, "")
                table.add_row(row.check, row.verdict, Text(row.note), style=colour)
            screen.print(table)
            numbers = report.law.model_dump(mode="json", exclude_none=True, exclude={"kind"})
            said = ", ".join(f"{key} = {in_toml(value)}" for key, value in numbers.items())
            screen.print(f"Drawn with {said}", markup=False, highlight=False, soft_wrap=True)
            with writing(out, overwrite=overwrite) as files:
                save_figure(report.law, files.claim(f"{kind}.png"))
            screen.print(f"Picture: {out / f'{kind}.png'}", soft_wrap=True)
        if not sound:
            raise typer.Exit(EXIT_ERROR)
