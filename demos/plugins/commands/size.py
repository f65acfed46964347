"""`ruptfx size`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx.plugin import check_all, reported, screen

HEADING = "Post-process"


def size(run: Annotated[Path, typer.Argument(help="Run directory.")]) -> None:
    """Print the size of the files of a run.

    Example: ruptfx size runs/impact
    """
    with reported():
        check_all(run)
        total = sum(path.stat().st_size for path in run.rglob("*") if path.is_file())
        screen.print(f"{total / 1e6:.3g} MB")
