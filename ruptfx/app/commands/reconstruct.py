"""`ruptfx reconstruct`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ruptfx.app.commands._gradients import Quiet, Ranks, case_on_ranks
from ruptfx.app.commands._shared import CaseFile, Overrides, Overwrite, errors, reported, screen, writing

HEADING = "Compute"
FOLDER = Path("reconstructions")


def reconstruct(
    case: CaseFile,
    ranks: Ranks = 1,
    out: Annotated[Path | None, typer.Option(help="Directory; default reconstructions/<name of the case>.")] = None,
    set_: Overrides = None,
    responses: Annotated[
        Path, typer.Option(help="Folder of impulse responses, which experiments with the same sensors share.")
    ] = FOLDER / "responses",
    quiet: Quiet = False,
    overwrite: Overwrite = False,
) -> None:
    """Compute slip rate, traction and friction along an interface from sensors, with exact Gaussian uncertainty.

    Example: ruptfx reconstruct case.toml --out reconstructions/first
    """
    from ruptfx.platform import launch

    out = out or FOLDER / case.stem
    flags = ["--responses", str(responses), *["--overwrite"] * overwrite]
    parsed = case_on_ranks("reconstruct", case, ranks, out, set_ or [], None, quiet, flags)
    with reported():
        from ruptfx.platform import fem

        comm = fem.MPI.COMM_WORLD
    with reported(comm):
        launch.check_size(comm.size)
        from ruptfx.many_runs.reconstruction.figures import FIGURES
        from ruptfx.many_runs.reconstruction.reconstruct import reconstruct as compute
        from ruptfx.platform import parallel

        names = ["case.toml", "fitted.toml", "reconstruction.nc", "summary.json", *(f"{name}.png" for name in FIGURES)]

        def claim() -> None:
            with writing(out, [case], overwrite) as files:
                files.claim(*names)

        parallel.on_root(comm, claim)  # before the runs
        result = compute(parsed, responses, comm, not quiet)
        summary = result.summary()

        def write() -> None:
            from ruptfx.platform.run_files import write_json
            from ruptfx.results.figure_style import save
            from ruptfx.results.hdf5 import write_netcdf

            with writing(out, [case], overwrite) as files:
                parsed.save(files.place)
                write_netcdf(result.dataset(), files.place / "reconstruction.nc")
                write_json(files.place / "summary.json", summary)
                if result.law is not None and result.law.case is not None:
                    (files.place / "fitted.toml").write_text(result.law.case.to_toml(), encoding="utf-8")
                for name, draw in FIGURES.items():
                    save(draw(result), files.place / f"{name}.png", "png")
            for note in summary["notes"]:
                errors.print(note, style="yellow", soft_wrap=True)
            if quiet:
                return
            screen.print(summary["verdict"], style="bold", soft_wrap=True)
            if summary["unknowns"]:
                table = Table("unknown", "change", "±", "unit", box=None, pad_edge=False)
                for key, each in summary["unknowns"].items():
                    table.add_row(key, f"{each['change']:.4g}", f"{each['deviation']:.2g}", each["unit"])
                screen.print(table)
            screen.print(f"Files: {out} ({', '.join(names)})", soft_wrap=True)

        parallel.on_root(comm, write)
