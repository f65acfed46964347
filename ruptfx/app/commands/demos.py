"""`ruptfx demos`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

import ruptfx
from ruptfx import RuptfxError
from ruptfx.app.commands._shared import reported, screen, writing
from ruptfx.app.commands.new import SCHEMA_LINE, write_schema

HEADING = "Begin"


def demos(
    out: Annotated[Path, typer.Argument(help="A directory that does not exist yet.")] = Path("demos"),
    notebooks: Annotated[bool, typer.Option("--notebooks", help="Scripts also as Jupyter notebooks.")] = False,
    schema: Annotated[
        bool, typer.Option("--schema", help="With a JSON schema that every case names, for editors.")
    ] = False,
) -> None:
    """Copy the demo cases and scripts of the installed package.

    Example: ruptfx demos mine --notebooks
    """
    import shutil

    with reported():
        if os.path.lexists(out):
            raise RuptfxError(f"{out}: exists already; give another directory: ruptfx demos DIRECTORY")
        if notebooks:
            need_jupytext()
        name = Path(ruptfx.__file__).with_name("demos")
        with writing(out) as files:
            for file in filter(Path.is_file, name.iterdir()):
                shutil.copy(file, files.place)
            shutil.copytree(name / "plugins", files.place / "plugins", ignore=shutil.ignore_patterns("__pycache__"))
            if schema:
                write_schema(files.place)
                for case in sorted(files.place.glob("*.toml")):
                    case.write_text(SCHEMA_LINE + case.read_text())
            for script in sorted(files.place.glob("*.py")) if notebooks else []:
                write_notebook(script)
        shown = f"jupyter lab {out / 'shear_impact.ipynb'}" if notebooks else f"ruptfx check {out / 'impact.toml'}"
        screen.print(f"{out}: try  {shown}", soft_wrap=True)


def need_jupytext() -> None:
    """Refuse to make notebooks without jupytext, before any file is written.

    Raises
    ------
    RuptfxError
    """
    from importlib.util import find_spec

    if find_spec("jupytext") is None:
        raise RuptfxError("--notebooks: jupytext is not installed; install it with: pip install 'ruptfx[notebook]'")


def write_notebook(script: Path) -> Path:
    """Write a demo as a notebook beside the script; its first cell defines `__file__`."""
    import jupytext

    text = f'# %%\n__file__ = "{script.name}"\n\n{script.read_text(encoding="utf-8")}'
    notebook = jupytext.reads(text, fmt="py:percent")
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    path = script.with_suffix(".ipynb")
    jupytext.write(notebook, path)
    return path
