"""`ruptfx plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx.commands._shared import reported, screen


def plot(
    run: Annotated[Path, typer.Argument(help="Run or study directory.", show_default=False)],
    format_: Annotated[list[str], typer.Option("--format", help="png, pdf or svg; repeatable.")] = ["png"],  # noqa: B006
) -> None:
    """Draw the figures of a run, or the map of a study, again; needs no DOLFINx.

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

            for path in redraw(run, formats=tuple(format_)):
                screen.print(str(path))
            return
        from ruptfx import plots
        from ruptfx.record import Record

        for path in plots.save_all(Record(run), formats=tuple(format_)):
            screen.print(str(path))
