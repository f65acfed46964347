"""`ruptfx bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx.app.commands._shared import EXIT_ERROR, Overwrite, completed_from, reported

HEADING = "Verify and extend"


def names() -> list[str]:
    """Return the arguments of `ruptfx bench`."""
    from ruptfx.app.bench import benchmarks

    return ["all", "list", "table", *benchmarks()]


def bench(
    name: Annotated[
        str,
        typer.Argument(
            help="A benchmark, `all`, `list`, or `table` (of saved numbers).", autocompletion=completed_from(names)
        ),
    ] = "list",
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable rows.")] = False,
    fine: Annotated[bool, typer.Option("--fine", help="The resolution of the release table.")] = False,
    out: Annotated[Path, typer.Option(help="Folder of figures and numbers.")] = Path("bench"),
    jobs: Annotated[int, typer.Option(min=1, help="Benchmarks of `all` that run at the same time.")] = 1,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Folder of further benchmarks, as `tests/benchmarks` of a checkout; default: that of the checkout "
            "from which ruptfx runs.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    without: Annotated[
        list[str] | None,
        typer.Option(help="Leave one out of `all`; may be repeated.", autocompletion=completed_from(names)),
    ] = None,
) -> None:
    """Run verification and speed benchmarks; list failed checks at the end and exit non-zero if there are any.

    The core set checks an installation. The others reproduce published problems, and are in a checkout.

    Example: ruptfx bench waves --fine
    """
    with reported():
        from ruptfx.app.bench import run_benchmark

        if not run_benchmark(
            name, as_json=as_json, fine=fine, out=out, jobs=jobs, folder=folder, overwrite=overwrite,
            without=without or (),
        ):  # fmt: skip
            raise typer.Exit(EXIT_ERROR)
