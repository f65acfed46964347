"""Directories of results: one process at a time writes there, whose they are, files that are old or new, never half."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from ruptfx import RuptfxError, Table
from ruptfx.case import read_case
from ruptfx.plugins import CaseFile

LOCK = ".lock"


@contextmanager
def reserved(out: Path) -> Iterator[None]:
    """Make a directory and keep others out of it until the end, however that comes.

    The lock is the operating system's, so a killed process leaves none behind.

    Raises
    ------
    RuptfxError
        Another process works there, or nothing can be written.
    """
    file = _locked(out)
    try:
        yield
    finally:
        # A directory that was refused keeps no trace; removed before the lock is given up.
        Path(file.name).unlink(missing_ok=True)
        file.close()


def _locked(out: Path) -> IO[str]:
    """The open lock file, locked.

    Raises
    ------
    RuptfxError
    """
    if out.exists() and not out.is_dir():
        raise RuptfxError(f"{out}: exists already; choose another --out, or remove it")
    path = out / LOCK
    try:
        out.mkdir(parents=True, exist_ok=True)
        while True:
            file = path.open("a+")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                user = file.read().strip() or "another run"
                file.close()
                raise RuptfxError(
                    f"{out}: in use by {user}; wait until it ends, stop it, or choose another --out"
                ) from None
            except OSError:
                pass  # a file system without locks
            if path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat()):
                break
            file.close()  # the process that held it ended in between and removed the file
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
    except OSError as error:
        raise RuptfxError(f"{out}: cannot be written ({error.strerror}); choose another --out") from None
    return file


def is_finished(out: Path, case: CaseFile) -> bool:
    """Whether a directory holds the complete run of this case.

    Raises
    ------
    RuptfxError
        It holds a run of another case.
    """
    found = _case_hash(out)
    if found not in (None, case.hash):
        raise RuptfxError(
            f"{out}: holds a run of case {found}, this is case {case.hash}; resume with its own case.toml and "
            "without other values of --set, or choose another --out"
        )
    return (out / "summary.json").exists()


def _case_hash(out: Path) -> str | None:
    """Hash of the case whose run a directory holds; None where that cannot be told."""
    try:
        return str(read_case(out / "case.toml").hash)
    except RuptfxError:
        pass
    try:
        return str(json.loads((out / "summary.json").read_text())["case_hash"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def prepare(out: Path, again: CaseFile | None = None, overwrite: bool = False) -> None:
    """Refuse a reserved directory that is not empty.

    Parameters
    ----------
    out : Path
    again : case, optional
        Begin this case again where it was stopped early: what it left in `out` goes.
    overwrite : bool
        What a run of any case left in `out` goes.

    Raises
    ------
    RuptfxError
        The directory holds something else already, or what is there cannot be removed.
    """
    left = [path for path in out.iterdir() if path.name != LOCK]
    known = _holds_a_run(out) if overwrite else again is not None and _case_hash(out) == again.hash
    if not known:
        if left:
            why = "exists already and is no run" if overwrite else "exists already"
            raise RuptfxError(f"{out}: {why}; choose another --out, or remove it")
        return
    try:
        for path in left:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    except OSError as error:
        raise RuptfxError(f"{out}: cannot be written ({error.strerror}); choose another --out") from None


def _holds_a_run(out: Path) -> bool:
    """Whether a run began here: it had the directory for itself."""
    return (out / "case.toml").is_file() and any((out / name).is_file() for name in ("run.log", "result.nc"))


def write_json(path: Path, content: Table) -> None:
    """Write, sync, rename: the file is old or new, never half."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with temporary.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=2)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
