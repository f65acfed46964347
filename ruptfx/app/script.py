"""Start of a script that runs cases: check of its outputs, and errors in one line."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import TracebackType

from ruptfx import RuptfxError
from ruptfx.results import directories


def begin(*outputs: str | Path) -> None:
    """Check that outputs can be written before any computation, and show errors of ruptfx without traceback.

    Parameters
    ----------
    outputs : str or Path
        Run directories, whose runs will be replaced with `overwrite=True`, and files or folders of results.

    Raises
    ------
    RuptfxError
        If an output is not writable, or contains files other than a run.
    """
    sys.excepthook = _shown
    for path in map(Path, outputs):
        there = next(place for place in (path, *path.absolute().parents) if place.exists())
        if not os.access(there, os.W_OK) or not (there.is_dir() or there == path):
            raise RuptfxError(f"{path}: cannot be written ({there}); run the script in another directory")
        if (path / "case.toml").exists():
            directories.check_replaceable(path)


def _shown(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an error of ruptfx in one line, others as usual; Python then exits with 1."""
    if isinstance(error, RuptfxError):
        sys.stderr.write(f"error: {error}\n")
    else:
        sys.__excepthook__(kind, error, trace)
