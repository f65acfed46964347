"""`ruptfx demos`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import ruptfx
from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen


def demos(out: Annotated[Path, typer.Argument(help="A directory that does not exist yet.")] = Path("demos")) -> None:
    """Copy the demo cases and scripts, which an installed ruptfx brings along."""
    import shutil

    with reported():
        if out.exists():
            raise RuptfxError(f"{out}: exists already; give another directory: ruptfx demos DIRECTORY")
        given = Path(ruptfx.__file__).with_name("demos")
        shutil.copytree(given, out, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
        screen.print(f"{out}: try  ruptfx check {out / 'impact.toml'}", soft_wrap=True)
