"""What commands share: consoles, arguments, errors as messages."""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.terminal import console

if TYPE_CHECKING:
    from mpi4py import MPI

    from ruptfx.plugins import CaseFile as HasPlugins

screen = console()
errors = console(stderr=True)

CaseFile = Annotated[Path, typer.Argument(help="Case file (TOML).", show_default=False)]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", help='KEY=VALUE, e.g. faults.main.initial_stress.normal="30 MPa"; repeatable.'),
]
EXIT_ERROR = RuptfxError.exit_code


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
        if error.at_once:
            sys.stderr.flush()
            os._exit(error.exit_code)
        raise typer.Exit(error.exit_code) from None
    except Exception:
        if comm is None or comm.size == 1:
            raise
        sys.stderr.write(traceback.format_exc())
        sys.stderr.flush()
        time.sleep(0.5)  # mpiexec passes it on before it ends all
        comm.Abort(EXIT_ERROR)


def completed_from(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """What the Tab key offers in a shell: the names, found when it is hit, that begin with what was typed."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def show_plugins(case: HasPlugins, wanted: bool) -> None:
    """Which files of the user's a command runs code of."""
    from ruptfx.plugins import shown

    for line in shown(case) if wanted else []:
        errors.print(line, markup=False, highlight=False, soft_wrap=True)
