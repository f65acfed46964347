"""`ruptfx movie`."""

from __future__ import annotations

from enum import StrEnum
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer

from ruptfx.app.commands._shared import Interface, Overwrite, begin, completed_from, reported, runs, screen, writing

HEADING = "Post-process"


class Format(StrEnum):  # older Typers know no Literal
    """File formats of movies."""

    gif = "gif"
    mp4 = "mp4"


def films() -> list[str]:
    """Return the kinds of movies, the files of their folder and entry points of packages."""
    files = (Path(__file__).parents[2] / "results" / "movies").glob("[!_]*.py")
    return sorted({*(path.stem for path in files), *(entry.name for entry in entry_points(group="ruptfx.movies"))})


def movie(
    run: Annotated[Path, typer.Argument(help="Run directory.", autocompletion=runs, show_default=False)],
    what: Annotated[
        str,
        typer.Option(help=f"One of {', '.join(films())}.", autocompletion=completed_from(films)),
    ] = "velocity",
    format_: Annotated[Format, typer.Option("--format", help="mp4 needs the extra movie, or ffmpeg.")] = Format.gif,
    out: Annotated[Path | None, typer.Option(help="File; default RUN/figures/WHAT.gif.")] = None,
    rate: Annotated[float, typer.Option(min=0.1, max=100.0, help="Frames per second.")] = 12.0,
    frames: Annotated[int, typer.Option(min=2, help="Largest number of frames.")] = 200,
    interface: Interface = None,
    overwrite: Overwrite = False,
) -> None:
    """Show a run as a movie: a field of the bodies with the slip rate below it; needs no DOLFINx.

    Example: ruptfx movie runs/impact --what fringes --rate 3
    """
    begin(f"reading {run}")
    with reported():
        from ruptfx.platform.progress import Progress
        from ruptfx.results import movies
        from ruptfx.results.record import Record

        path = out or run / "figures" / f"{what}{f'_{interface}' if interface else ''}.{format_}"
        with Record(run) as run_record, run_record.on(interface) as record, \
                writing(path.parent, overwrite=overwrite) as files, Progress() as bar:  # fmt: skip
            count = movies.save(record, what, files.claim(path.name), rate, frames, bar.update)
        screen.print(f"{path}, {count} frames", soft_wrap=True)
