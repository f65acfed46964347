"""What commands share: consoles, arguments, errors as messages."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from ruptfx import RuptfxError
from ruptfx.terminal import console

if TYPE_CHECKING:
    from mpi4py import MPI

    from ruptfx.plugins import CaseFile as HasPlugins

screen = console()
errors = console(stderr=True)

CaseFile = Annotated[Path, typer.Argument(help="Case file (TOML).", show_default=False)]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", help="KEY=VALUE, e.g. faults.main.initial_stress.normal=30e6; repeatable.")
]
EXIT_ERROR, EXIT_INTERRUPTED = 1, 130


@contextmanager
def reported(comm: MPI.Comm | None = None) -> Iterator[None]:
    """Our errors are one message from one rank; a bug shows its traceback and ends all ranks."""
    from ruptfx.schema import CaseError

    try:
        yield
        sys.stdout.flush()  # a reader that has seen enough is noticed here, where it ends the command quietly
    except RuptfxError as error:
        if comm is None or comm.rank == 0:
            label = "case error" if isinstance(error, CaseError) else "error"
            errors.print(f"{label}: ", style="bold red", end="")
            errors.print(str(error), soft_wrap=True)
        if type(error).__name__ == "DiskError":
            # HDF5 cannot write what it still holds and would fall over it at exit.
            sys.stderr.flush()
            os._exit(EXIT_ERROR)
        raise typer.Exit(EXIT_INTERRUPTED if type(error).__name__ == "Interrupted" else EXIT_ERROR) from None
    except Exception:
        if comm is None or comm.size == 1:
            raise
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(EXIT_ERROR)


def show_plugins(case: HasPlugins, wanted: bool) -> None:
    """Which files of the user's a command runs code of."""
    from ruptfx.plugins import shown

    for line in shown(case) if wanted else []:
        errors.print(line, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def fraction_bar(show: bool) -> Iterator[Callable[[float, str], None]]:
    """A bar for work that tells its fraction and what it is at."""
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    with Progress(*columns, console=errors, disable=not (show and errors.is_terminal)) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda fraction, text: bar.update(task, completed=fraction, description=text)
