"""`ruptfx plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx.commands._shared import errors, reported, runs, screen


def plot(
    run: Annotated[Path, typer.Argument(help="Run or study directory.", autocompletion=runs, show_default=False)],
    format_: Annotated[list[str], typer.Option("--format", help="png, pdf or svg; repeatable.")] = ["png"],  # noqa: B006
    trust: Annotated[bool, typer.Option("--trust", help="Run plug-ins of the run where figures need them.")] = False,
) -> None:
    """Draw the figures of a run, or the map of a study, again; needs no DOLFINx.

    Plug-ins of the run are not executed without --trust; figures that need them are then skipped and listed.

    Example: ruptfx plot runs/impact --format pdf --format png
    """
    with reported():
        if (run / "study.json").exists():
            from ruptfx.study.execute import draw

            for path in draw(run, formats=tuple(format_)):
                screen.print(str(path))
            return
        if (run / "result.nc").exists():
            from ruptfx.lumped import redraw

            for path in redraw(run, formats=tuple(format_), trust=trust):
                screen.print(str(path))
            return
        from ruptfx import plots
        from ruptfx.record import Record

        with Record(run, trust) as record:
            for path in plots.save_all(record, formats=tuple(format_)):
                screen.print(str(path))
            for omitted in dict.fromkeys(record.omitted):
                errors.print(f"left out: {omitted}; a plug-in of the run has the law. If you trust it, add --trust",
                             markup=False, highlight=False, soft_wrap=True)  # fmt: skip
