"""`ruptfx gradient`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx.app.commands._gradients import Memory, Quiet, Ranks, case_on_ranks
from ruptfx.app.commands._shared import CaseFile, Overrides, Overwrite, errors, reported, screen, writing

if TYPE_CHECKING:
    import xarray

HEADING = "Compute"


def gradient(
    case: CaseFile,
    ranks: Ranks = 1,
    out: Annotated[Path | None, typer.Option(help="Directory; default gradients/<name of the case>.")] = None,
    set_: Overrides = None,
    memory: Memory = 4.0,
    check: Annotated[
        bool, typer.Option("--check", help="Compare with differences of two more runs for each unknown.")
    ] = False,
    cores: Annotated[int, typer.Option(min=1, help="Cores for simultaneous runs of --check.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a dask scheduler for these runs; default is this machine.")
    ] = None,
    quiet: Quiet = False,
    overwrite: Overwrite = False,
) -> None:
    """Differentiate the objective of a case by its unknowns: one run forward and one sweep backward.

    Example: ruptfx gradient demos/sensitivity.toml
    """
    from ruptfx.platform import launch

    out = out or Path("gradients") / case.stem
    flags = ["--check"] * check + (["--cores", str(cores)] if cores > 1 else [])
    flags += ["--scheduler", scheduler] if scheduler else []
    flags += ["--overwrite"] * overwrite
    parsed = case_on_ranks("gradient", case, ranks, out, set_ or [], memory, quiet, flags)
    with reported():
        from ruptfx.platform import fem

        comm = fem.MPI.COMM_WORLD
    with reported(comm):
        launch.check_size(comm.size)
        from ruptfx.many_runs.adjoint.gradients import gradient as differentiate
        from ruptfx.platform import parallel

        def claim() -> None:
            with writing(out, [case], overwrite) as files:
                files.claim("case.toml", "gradient.nc", "gradient.png")

        parallel.on_root(comm, claim)  # before the runs
        result = differentiate(parsed, comm=comm, progress=not quiet, memory=1e9 * memory, check=check,
                              cores=cores, scheduler=scheduler)  # fmt: skip

        def write() -> None:
            from ruptfx.many_runs.adjoint.figure import draw
            from ruptfx.results.figure_style import save
            from ruptfx.results.hdf5 import write_netcdf

            with writing(out, [case], overwrite) as files:
                parsed.save(files.place)
                write_netcdf(result, files.place / "gradient.nc")
                save(draw(result), files.place / "gradient.png", "png")
            if check:
                _warn(result)
            if quiet:
                return
            unit = result["objective"].attrs["units"]
            screen.print(f"objective: {float(result['objective']):.6g} {unit if unit != '1' else ''}", style="bold")
            differences = ["by differences"] * check
            table = Table("unknown", "by a uniform change", *differences, "unit", box=None, pad_edge=False)
            for values in result.data_vars.values():
                if "unknown" in values.attrs:
                    numbers = [f"{values.attrs['uniform_change']:.6g}"]
                    if check:
                        other = values.attrs.get("by_differences")
                        numbers.append("" if other is None else f"{other:.6g}")
                    table.add_row(values.attrs["unknown"], *numbers, values.attrs["units"])
            screen.print(table)
            screen.print(result.attrs["history"], highlight=False)
            screen.print(f"Files: {out / 'gradient.nc'}, {out / 'gradient.png'}", soft_wrap=True)

        parallel.on_root(comm, write)


def _warn(found: xarray.Dataset) -> None:
    """Name the unknowns of which differences of runs say another derivative."""
    from ruptfx.many_runs.adjoint.comparison import disagree

    for values in found.data_vars.values():
        exact, other = (values.attrs.get(name) for name in ("uniform_change", "by_differences"))
        if exact is not None and other is not None and disagree(exact, other):
            step = values.attrs["difference_step"]
            errors.print(
                f"{values.attrs['unknown']}: the gradient says {exact:.4g}, runs with changes of {step:.3g} say "
                f"{other:.4g}. A point begins to slide, stops or opens at another step: the gradient is that of the "
                "branch that the run took, and holds for smaller changes only.", style="yellow", soft_wrap=True
            )  # fmt: skip
