"""The directory of a run on many ranks: the operations of `ruptfx.results.directories`, on all of them or none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ruptfx.case import Case
from ruptfx.platform import parallel
from ruptfx.results import directories

if TYPE_CHECKING:
    from ruptfx.platform import fem


@contextmanager
def reserved(comm: fem.MPI.Comm, out: Path) -> Iterator[None]:
    """Create the run directory and lock it against other runs until the end of the context; collective.

    Raises
    ------
    RuptfxError
        On all ranks: another run writes there, or the directory cannot be written.
    """
    with ExitStack() as stack:
        parallel.on_root(comm, lambda: stack.enter_context(directories.reserved(out)))
        yield


def is_finished(comm: fem.MPI.Comm, out: Path, case: Case) -> bool:
    """Return whether a directory contains the complete run of this case; collective.

    Raises
    ------
    RuptfxError
        On all ranks: it contains a run of another case.
    """
    return parallel.on_root(comm, lambda: directories.is_finished(out, case))


def begun(comm: fem.MPI.Comm, out: Path, case: Case) -> Path:
    """Return the directory in which a run of this case was begun, `out` or its `.new`; collective."""
    return parallel.on_root(comm, lambda: directories.begun(out, case))


def prepare(comm: fem.MPI.Comm, out: Path, again: Case | None = None, overwrite: bool = False) -> Path:
    """Return an empty directory for a new run, `out` or its `.new`; collective, see `directories.prepare`.

    Raises
    ------
    RuptfxError
        On all ranks: the directory contains other files already, or cannot be written.
    """
    return parallel.on_root(comm, lambda: directories.prepare(out, again, overwrite))


def replace(comm: fem.MPI.Comm, out: Path) -> None:
    """Put a complete run in `.new` in its place; collective.

    Raises
    ------
    RuptfxError
        On all ranks.
    """
    parallel.on_root(comm, lambda: directories.replace(out))
