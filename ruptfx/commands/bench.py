"""`ruptfx bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx.commands._shared import EXIT_ERROR, reported


def bench(
    name: Annotated[str, typer.Argument(help="A benchmark, `all`, `list`, or `table` (of saved numbers).")] = "list",
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable rows.")] = False,
    fine: Annotated[bool, typer.Option("--fine", help="The resolution of the release table.")] = False,
    out: Annotated[Path, typer.Option(help="Where figures go.")] = Path("bench"),
) -> None:
    """Run verification and speed benchmarks; exits non-zero when a check fails."""
    with reported():
        from ruptfx.bench import run_benchmark

        if not run_benchmark(name, as_json=as_json, fine=fine, out=out):
            raise typer.Exit(EXIT_ERROR)
