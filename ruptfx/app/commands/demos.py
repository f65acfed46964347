"""`ruptfx demos`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

import ruptfx
from ruptfx import RuptfxError
from ruptfx.app.commands._shared import reported, screen, table_console, writing
from ruptfx.app.commands.new import SCHEMA_LINE, write_schema
from ruptfx.app.reference.sources import files_of, rows_of

HEADING = "Begin"


def demos(
    out: Annotated[Path, typer.Argument(help="A directory that does not exist yet.")] = Path("demos"),
    notebooks: Annotated[bool, typer.Option("--notebooks", help="Scripts also as Jupyter notebooks.")] = False,
    schema: Annotated[
        bool, typer.Option("--schema", help="With a JSON schema that every case names, for editors.")
    ] = False,
    source: Annotated[
        str, typer.Option("--source", help="Only what computes figures of one source document, as 001; lists them.")
    ] = "",
) -> None:
    """Copy the demo cases and scripts of the installed package, or those of one of the documents that it comes from.

    Example: ruptfx demos mine --notebooks
    """
    import shutil

    with reported():
        if os.path.lexists(out):
            raise RuptfxError(f"{out}: exists already; give another directory: ruptfx demos DIRECTORY")
        if notebooks:
            need_jupytext()
        folder = Path(ruptfx.__file__).with_name("demos")
        copied = files_of(source, folder) if source else [*filter(Path.is_file, folder.iterdir()), folder / "plugins"]
        with writing(out) as files:
            for path in copied:
                if path.is_dir():
                    shutil.copytree(path, files.place / path.name, ignore=shutil.ignore_patterns("__pycache__"))
                else:
                    shutil.copy(path, files.place)
            if schema:
                write_schema(files.place)
                for case in sorted(files.place.glob("*.toml")):
                    case.write_text(SCHEMA_LINE + case.read_text())
            for script in sorted(files.place.glob("*.py")) if notebooks else []:
                write_notebook(script)
        if source:
            from ruptfx.app.bench import IN_A_CHECKOUT, benchmarks

            table = Table("figure or formula", "command", box=None, pad_edge=False)
            rows = rows_of(source)
            for row in rows:
                table.add_row(row.what, row.command.replace("demos/", f"{out}/") or "-")
            table_console().print(table)
            names = {row.command.split()[2] for row in rows if row.command.startswith("ruptfx bench ")}
            if elsewhere := ", ".join(sorted(names - benchmarks().keys())):
                screen.print(f"bench {elsewhere}: in a checkout of ruptfx: --from {IN_A_CHECKOUT}", soft_wrap=True)
            return
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
