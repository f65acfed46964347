"""The command line: `ruptfx COMMAND`, each in its file of `ruptfx.commands`."""

from __future__ import annotations

from importlib import import_module
from typing import Annotated

import typer

from ruptfx import __version__

COMMANDS = {
    "Begin": ("new", "convert", "demos", "describe"),
    "Compute": ("check", "mesh", "run", "resume", "study"),
    "Look at it": ("list", "plot", "movie", "dic", "compare", "events", "export"),
    "Trust and extend": ("bench", "check_law", "cite"),
}
"""By the heading under which `--help` lists them."""

app = typer.Typer(
    help="Frictional contact and rupture on FEniCSx.", no_args_is_help=True, pretty_exceptions_enable=False
)


@app.callback(invoke_without_command=True)
def main(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit


for _heading, _names in COMMANDS.items():
    for _name in _names:
        _function = getattr(import_module(f"ruptfx.commands.{_name}"), _name)
        app.command(name=_name.replace("_", "-"), rich_help_panel=_heading)(_function)


if __name__ == "__main__":
    app()
