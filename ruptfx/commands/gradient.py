"""`ruptfx gradient`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.commands._shared import CaseFile, Overrides, errors, reported, screen


def gradient(
    case: CaseFile,
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks to start.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Directory; default gradients/<name of the case>.")] = None,
    set_: Overrides = None,
    memory: Annotated[float, typer.Option(min=0, help="Memory for the history of the interfaces in GB.")] = 4.0,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, no table.")] = False,
) -> None:
    """Differentiate the objective of a case by its unknowns: one run forward and one sweep backward.

    Example: ruptfx gradient demos/sensitivity.toml
    """
    from ruptfx.case import Case, read_case
    from ruptfx.platform import launch

    out = out or Path("gradients") / case.stem
    with reported():
        parsed = read_case(case, set_ or [])
        if not isinstance(parsed, Case):
            raise RuptfxError(f"{case}: {parsed.kind()} is a lumped model and has no gradient")
    if ranks > 1 and launch.RANKS not in os.environ:
        options = [item for value in set_ or [] for item in ("--set", value)] + ["--quiet"] * quiet
        if not quiet:
            errors.print(f"starting {ranks} ranks")
        with reported():
            code = launch.run_on(
                ranks, ["gradient", "--out", str(out), "--memory", str(memory), *options, "--", str(case)]
            )
        if code:
            raise typer.Exit(code)
        return
    with reported():
        from ruptfx import fem

        comm = fem.MPI.COMM_WORLD
    with reported(comm):
        launch.check_size(comm.size)
        from ruptfx.adjoint.gradients import gradient as differentiate
        from ruptfx.platform import parallel

        found = differentiate(parsed, comm=comm, progress=not quiet, memory=1e9 * memory)

        def write() -> None:
            from ruptfx.adjoint.figure import draw
            from ruptfx.figure_style import save

            out.mkdir(parents=True, exist_ok=True)
            parsed.save(out)
            found.to_netcdf(out / "gradient.nc", engine="h5netcdf")
            save(draw(found), out / "gradient.png", "png")
            if quiet:
                return
            unit = found["objective"].attrs["units"]
            screen.print(f"objective: {float(found['objective']):.6g} {unit}", style="bold")
            table = Table("unknown", "by a uniform change", "unit", box=None, pad_edge=False)
            for values in found.data_vars.values():
                if "unknown" in values.attrs:
                    change = values.attrs["uniform_change"]
                    table.add_row(values.attrs["unknown"], f"{change:.6g}", values.attrs["units"])
            screen.print(table)
            screen.print(f"Files: {out / 'gradient.nc'}, {out / 'gradient.png'}", soft_wrap=True)

        parallel.on_root(comm, write)
