"""Gmsh while something is meshed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType


@contextmanager
def session() -> Iterator[ModuleType]:
    """Gmsh, silent; ended whatever happens."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
    finally:
        gmsh.finalize()
        with suppress(ValueError):  # not the main thread
            # It leaves the signal as the system has it: writing to a process that has ended would end this one.
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
