"""`ruptfx resume`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import reported, runs
from ruptfx.app.commands.run import run as run_command

HEADING = "Compute"


def resume(
    run: Annotated[Path, typer.Argument(help="Run directory.", autocompletion=runs, show_default=False)],
    duration: Annotated[
        str | None, typer.Option(metavar="<time>", help="New duration of the run, as '90 us', or a number in s.")
    ] = None,
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks to start.")] = 1,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, no summary.")] = False,
) -> None:
    """Resume an interrupted run from its newest checkpoint; with --duration also extend a finished one.

    Example: ruptfx resume runs/impact --duration "90 us" --ranks 2
    """
    with reported():
        if not (run / "case.toml").exists():
            raise RuptfxError(
                f"{run}: no run directory: it holds no case.toml; give the directory that 'ruptfx run' wrote"
            )
        from ruptfx.platform import run_files
        from ruptfx.results import directories

        case = directories.unfinished(run) / "case.toml"
        run_files.check(case.parent, case.name)
        if duration is not None:
            from ruptfx.case import override, parse_case, read_case, read_toml
            from ruptfx.lumped import LumpedModel
            from ruptfx.run.recording.extension import extend

            before = read_case(case)
            if isinstance(before, LumpedModel):
                raise RuptfxError(f"{run}: {before.kind()} is a lumped model, and is not resumed; run it again")
            table = read_toml(case)
            override(table, f"duration={duration}")
            longer = parse_case(table, case.resolve().parent)
            assert not isinstance(longer, LumpedModel)
            extend(run, before, longer)
            case = directories.unfinished(run) / "case.toml"
    run_command(case, ranks=ranks, out=run, resume=True, quiet=quiet)
