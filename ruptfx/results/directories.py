"""Result directories: one process at a time writes there, and a run is replaced only by a complete one.

A run that replaces another is computed in the hidden directory `.new` inside the other one. When it is complete, its
files replace those listed in `files.json`; all others belong to the user and stay.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Protocol

from ruptfx import RuptfxError
from ruptfx.platform import run_files

LOCK = ".lock"
NEW = ".new"
CHECKPOINTS = "checkpoints"
FINAL = "final"  # the checkpoint of a complete run


class RunCase(Protocol):
    """The case of a run, as far as its directory depends on it."""

    @property
    def hash(self) -> str:
        """Content hash, equal for cases of the same run."""

    def hash_in(self, directory: Path) -> str | None:
        """Return the hash of the case of the run in a directory; None if unknown."""


@contextmanager
def reserved(out: Path) -> Iterator[None]:
    """Create a directory and lock it for other processes until the end of the context.

    The lock belongs to the operating system, which releases it if the process is killed. If a process was killed while
    it replaced a run, the replacement is completed first.

    Raises
    ------
    RuptfxError
        If another process uses the directory, or it is not writable.
    """
    file = _locked(out)
    try:
        replace(out)
        yield
    finally:
        # Leave no files in a refused directory; remove them before the lock is released.
        Path(file.name).unlink(missing_ok=True)
        file.close()


def _locked(out: Path) -> IO[str]:
    """Return the open lock file, locked.

    Raises
    ------
    RuptfxError
    """
    if out.exists() and not out.is_dir():
        raise RuptfxError(f"{out}: exists already; choose another directory, or remove it")
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


def is_finished(out: Path, case: RunCase) -> bool:
    """Return whether a directory contains the complete run of this case.

    Raises
    ------
    RuptfxError
        If it contains a run of another case, or its case or a file that the run reads was changed.
    """
    end_replacement(out)
    if case.hash_in(out / NEW) == case.hash:
        run_files.check_inputs(out / NEW)
        return False
    run_files.check(out, run_files.CASE)
    result = case.hash_in(out)
    if result not in (None, case.hash):
        raise RuptfxError(
            f"{out}: holds a run of case {result}, this is case {case.hash}; resume with its own case.toml and "
            "without other values of --set, or choose another --out"
        )
    run_files.check_inputs(out)
    return (out / run_files.SUMMARY).exists()


def begun(out: Path, case: RunCase) -> Path:
    """Return where a run of this case was begun: in the directory, or in its `.new`."""
    return out / NEW if case.hash_in(out / NEW) == case.hash else out


def unfinished(out: Path) -> Path:
    """Return where a resumed run goes on: in `.new` if a run there was stopped, else in the directory itself."""
    end_replacement(out)
    return out / NEW if (out / NEW / run_files.CASE).is_file() else out


def home(place: Path) -> Path:
    """Return the run directory to which a directory of computation belongs."""
    return place.parent if place.name == NEW else place


def prepare(out: Path, again: RunCase | None = None, overwrite: bool = False) -> Path:
    """Return an empty directory for a new run: `out`, or its `.new` if a run is to be replaced.

    Parameters
    ----------
    out : Path
        Reserved directory.
    again : case, optional
        Start this case again if its run was stopped early.
    overwrite : bool
        Replace a run of any case, once the new one is complete.

    Raises
    ------
    RuptfxError
        If the directory contains other files, or is not writable.
    """
    if not any(path.name != LOCK for path in out.iterdir()):
        return out
    if overwrite:
        check_replaceable(out)
        return renew(out / NEW)
    if again is not None:
        place = begun(out, again)
        if place != out:
            return renew(place)
        if again.hash_in(out) == again.hash:
            return out
    remedy = "replace the run with --overwrite (in Python overwrite=True), " if _holds_a_run(out) else ""
    raise RuptfxError(f"{out}: exists already; {remedy}choose another directory, or remove it")


def check_replaceable(out: Path) -> None:
    """Refuse a directory whose run cannot be replaced.

    Raises
    ------
    RuptfxError
        If it contains no run, or one without a list of its files.
    """
    if not _holds_a_run(out):
        raise RuptfxError(f"{out}: exists already and is no run; choose another directory, or remove it")
    if run_files.listed(out) is None:
        raise RuptfxError(
            f"{out}: holds a run without {run_files.NAME}, so its files cannot be told from yours; choose another "
            "directory, or remove it"
        )


def refuse_links(out: Path) -> None:
    """Refuse a directory with symbolic links out of it, through which a run would write.

    Raises
    ------
    RuptfxError
    """
    inside = out.resolve()
    for path in sorted(out.rglob("*")):
        if path.is_symlink() and not path.resolve().is_relative_to(inside):
            raise RuptfxError(
                f"{path}: a link to {path.resolve()}, outside of the run directory, where nothing is written; replace "
                "it by a copy of what it leads to"
            )


def _holds_a_run(out: Path) -> bool:
    """Return whether a run was started here in an empty directory."""
    marks = ("run.log", "result.nc", run_files.NAME)
    return (out / run_files.CASE).is_file() and any((out / name).is_file() for name in marks)


def renew(place: Path) -> Path:
    """Create a hidden directory anew; all its files are ours.

    Raises
    ------
    RuptfxError
    """
    try:
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
    except OSError as error:
        raise RuptfxError(f"{place}: cannot be written ({error.strerror}); choose another --out") from None
    return place


def end_replacement(out: Path) -> None:
    """Complete the replacement by a complete run in `.new`, if the process that did it was killed."""
    if (out / NEW / run_files.SUMMARY).is_file():
        with reserved(out):
            pass


def replace(out: Path) -> None:
    """Replace the run in a reserved directory by the complete run in `.new`, if there is one.

    May be repeated after a kill at any point: `.new` has its summary until the very end, and from the first change the
    directory has none, so that it never passes as a complete run meanwhile.

    Raises
    ------
    RuptfxError
    """
    new, moving = out / NEW, out / NEW / ".moving"
    if not (new / run_files.SUMMARY).is_file():
        return
    try:
        if (new / run_files.NAME).is_file():
            files = run_files.listed(new) or {}
            old = run_files.listed(out)
            (out / run_files.SUMMARY).unlink(missing_ok=True)
            for name in (old or {}).keys() - files.keys():
                _remove(_inside(out, name))
            for name in [name for name in files if name != run_files.SUMMARY and (new / name).is_file()]:
                there = _inside(out, name)
                if old is not None and name not in old and there.exists():  # the user's: the run there had no such file
                    there.replace(there.with_name(f"{there.name}.kept"))
                there.parent.mkdir(exist_ok=True)
                (new / name).replace(there)
            if (new / CHECKPOINTS).is_dir():
                _remove_checkpoints(out)
                (new / CHECKPOINTS).replace(moving)
            for path in moving.glob("*"):
                (out / CHECKPOINTS).mkdir(exist_ok=True)
                path.replace(out / CHECKPOINTS / path.name)
            (new / run_files.NAME).replace(out / run_files.NAME)
        (new / run_files.SUMMARY).replace(out / run_files.SUMMARY)
        shutil.rmtree(new, ignore_errors=True)
    except OSError as error:
        raise RuptfxError(
            f"{out}: the complete run in {new} cannot be moved there ({error.strerror or error}); remedy that, then: "
            f"ruptfx resume {out}"
        ) from None


def _inside(out: Path, name: str) -> Path:
    """Return the path of a listed file.

    Raises
    ------
    OSError
        If a link leads out of the directory.
    """
    path = out / name
    if path.parent != out and path.parent.is_symlink():
        raise OSError(f"{path.parent} is a link")
    return path


def _remove(path: Path) -> None:
    """Remove a file, and its folder if it is empty then."""
    if path.is_file() or path.is_symlink():
        path.unlink()
    with suppress(OSError):  # not empty, or not there
        path.parent.rmdir()


def _remove_checkpoints(out: Path) -> None:
    folder = out / CHECKPOINTS
    if folder.is_symlink():
        folder.unlink()
        return
    for path in (*folder.glob("step_*"), folder / FINAL, folder / ".unfinished"):
        shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        folder.rmdir()
