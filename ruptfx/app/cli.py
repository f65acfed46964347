"""The command line: `ruptfx COMMAND`, each in its file of `ruptfx.app.commands`."""

from __future__ import annotations

import atexit
import ctypes
import inspect
import re
import sys
from collections.abc import Collection
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from ruptfx import __version__
from ruptfx.app import commands

HEADINGS = ("Begin", "Compute", "Post-process", "Verify and extend")
"""Order of the headings under which `--help` lists the commands; a command says its own."""


class Command(TyperCommand):
    """A command whose flags are shown without a type: they take no value."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types(super().get_params(ctx))


class Group(TyperGroup):
    """The program, whose flags are shown in the same way; `help COMMAND` stands for `COMMAND --help`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args[:1] == ["help"]:
            args = [*args[1:2], "--help"]
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        # Typer of DOLFINx 0.9 on Debian names no similar command.
        if not hasattr(self, "suggest_commands") and self.get_command(ctx, args[0]) is None:
            from difflib import get_close_matches

            if close := get_close_matches(args[0], self.list_commands(ctx)):
                ctx.fail(f"No such command '{args[0]}'. Did you mean {', '.join(map(repr, close))}?")
        return super().resolve_command(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types(super().get_params(ctx))


def _without_types(params: list[Any]) -> list[Any]:
    for each in params:
        if getattr(each, "is_flag", False) and each.metavar is None:
            each.metavar = " "
    return params


app = typer.Typer(
    cls=Group, help="Frictional contact and rupture on FEniCSx.", no_args_is_help=True, pretty_exceptions_enable=False
)


@app.callback(invoke_without_command=True)
def main(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Print the version on request."""
    if version:
        typer.echo(__version__)
        raise typer.Exit


def _paragraphs(text: str) -> str:
    """Return a docstring with each paragraph on one line: the help breaks lines at the width of the terminal."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in inspect.cleandoc(text).split("\n\n"))


def _of_packages(known: Collection[str]) -> dict[str, Any]:
    """Return the modules of commands that packages offer as entry points, group ``ruptfx.commands``, by name.

    One that cannot be used is named on stderr, and the other commands work.
    """
    modules = {}
    for entry in entry_points(group="ruptfx.commands"):
        try:
            if entry.name in known:
                raise ValueError("would hide the command that is there already; rename its entry point")
            module = entry.load()
            if getattr(module, entry.name).__doc__ is None or module.HEADING not in HEADINGS:
                raise ValueError(f"needs a docstring, and a HEADING of {', '.join(HEADINGS)}")
        except Exception as error:
            offer = f"command '{entry.name}' of {entry.dist.name if entry.dist else 'a package'}, {entry.value}"
            sys.stderr.write(f"warning: {offer}: {type(error).__name__}: {error}\n")
            continue
        modules[entry.name] = module
    return modules


# Not by `own_kinds` of `ruptfx.input.schema`, whose import doubles the time of `ruptfx --help`.
_names = [each.name for each in iter_modules(commands.__path__) if not each.name.startswith("_")]
_modules = {name: import_module(f"ruptfx.app.commands.{name}") for name in sorted(_names)} | _of_packages(_names)
for _name, _module in sorted(_modules.items(), key=lambda each: HEADINGS.index(each[1].HEADING)):
    _function, _heading = getattr(_module, _name), _module.HEADING
    _help = _paragraphs(_function.__doc__)
    _short = re.split(r"[:;]|\.\s|\.$", _help)[0] + "."  # of the list of commands
    _options = {"cls": Command, "help": _help, "short_help": _short, "rich_help_panel": _heading}
    app.command(name=_name.replace("_", "-"), **_options)(_function)


def program() -> None:
    """Run `ruptfx` as a program, and exit without the slow clean-up of the interpreter: seconds after a study."""
    try:
        app(prog_name="ruptfx")
    except SystemExit as ended:
        fem = sys.modules.get("ruptfx.platform.fem")  # not imported here: the help and the version do without NumPy
        loaded = fem if fem is not None and fem.is_loaded() else None
        if not isinstance(ended.code, int | None) or (loaded and ended.code):
            raise
        if loaded:
            loaded.finish()
        atexit._run_exitfuncs()
        sys.stdout.flush()  # includes the output of exit handlers
        sys.stderr.flush()
        # Not os._exit: MPICH tells mpiexec in an exit handler of C that this rank is done, and where none did mpiexec
        # takes it for a crash and now and then kills the others. No thread of Python's may run meanwhile (PyDLL).
        ctypes.PyDLL(None).exit(ended.code or 0)


if __name__ == "__main__":
    program()
