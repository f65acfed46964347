"""`ruptfx study`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ruptfx.app.commands._shared import EXIT_ERROR, Overrides, begin, reported, screen

HEADING = "Compute"
SHOWN = 3  # failed points that are printed; all are in the table


def study(
    file: Annotated[Path, typer.Argument(help="Study file (TOML).", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="Study directory; default studies/<name of the file>.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a dask scheduler; default is this machine.")] = None,
    cores: Annotated[int | None, typer.Option(min=1, help="Cores to use on this machine; default all.")] = None,
    refine: Annotated[bool, typer.Option("--refine", help="Locate mode boundaries, check on a finer mesh.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed points again.")] = False,
    set_: Overrides = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace another study in --out; points that both have are kept.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Run a case over axes of parameters; started again, run only the missing points.

    A point that fails has its error in the table and does not stop the others: the exit code is 0, or 1 if all failed.

    Example: ruptfx study demos/slip_weakening_map.toml --cores 2
    """
    begin(f"reading {file}", not quiet)
    with reported():
        from ruptfx.many_runs.study import read_study, run_study

        out = out or Path("studies") / file.stem
        parsed = read_study(file, set_ or [])
        values = run_study(parsed, out, scheduler=scheduler, cores=cores, refined=refine, retry=retry, show=not quiet,
                          overwrite=overwrite)  # fmt: skip
        screen.print(f"{len(values.points)} points, {values.failed} failed, {values.known_before} known before")
        for point, result in [each for each in values.points if each[1]["status"] == "failed"][:SHOWN]:
            place = ", ".join(f"{name} = {value}" for name, value in point.coordinates.items())
            screen.print(f"failed: {place}: {result['error']}", style="red", soft_wrap=True)
        if 0 < values.failed < len(values.points):
            screen.print(
                "The other points are complete (exit code 0); --retry runs failed points again.", soft_wrap=True
            )
        if refine:
            screen.print(json.loads((out / "refinement.json").read_text())["summary"])
        screen.print(f"Study directory: {out} ({', '.join(path.name for path in values.files)})", soft_wrap=True)
        if values.failed == len(values.points):
            raise typer.Exit(EXIT_ERROR)
