"""`ruptfx gradient`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ruptfx.commands._gradients import Memory, Quiet, Ranks, case_on_ranks
from ruptfx.commands._shared import CaseFile, Overrides, reported, screen

HEADING = "Compute"


def gradient(
    case: CaseFile,
    ranks: Ranks = 1,
    out: Annotated[Path | None, typer.Option(help="Directory; default gradients/<name of the case>.")] = None,
    set_: Overrides = None,
    memory: Memory = 4.0,
    quiet: Quiet = False,
) -> None:
    """Differentiate the objective of a case by its unknowns: one run forward and one sweep backward.

    Example: ruptfx gradient demos/sensitivity.toml
    """
    from ruptfx.platform import launch

    out = out or Path("gradients") / case.stem
    parsed = case_on_ranks("gradient", case, ranks, out, set_ or [], memory, quiet)
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
            screen.print(f"objective: {float(found['objective']):.6g} {unit if unit != '1' else ''}", style="bold")
            table = Table("unknown", "by a uniform change", "unit", box=None, pad_edge=False)
            for values in found.data_vars.values():
                if "unknown" in values.attrs:
                    change = values.attrs["uniform_change"]
                    table.add_row(values.attrs["unknown"], f"{change:.6g}", values.attrs["units"])
            screen.print(table)
            screen.print(found.attrs["history"], highlight=False)
            screen.print(f"Files: {out / 'gradient.nc'}, {out / 'gradient.png'}", soft_wrap=True)

        parallel.on_root(comm, write)
