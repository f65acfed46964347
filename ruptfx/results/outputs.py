"""Files that commands write into folders of the user.

Files are written into a hidden directory of their folder and moved from there when all of them are complete, so that
an error keeps what was there. `.ruptfx` of the folder lists their checksums: a file that is not listed, or was
changed since, belongs to the user and is replaced on request only.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self

from ruptfx import RuptfxError
from ruptfx.platform import run_files
from ruptfx.platform.files import checksum

if TYPE_CHECKING:
    from types import TracebackType

NAME = ".ruptfx"
FIGURES = "figures"
HIDDEN = ".ruptfx-"  # begin of the names of directories with unfinished files
SAID = {
    errno.ENOSPC: "the disk is full", errno.EDQUOT: "the quota of the disk is used up",
    errno.EFBIG: "a file would be larger than the limit (ulimit -f)", errno.EROFS: "the disk is read-only",
    errno.EACCES: "permission denied", errno.EPERM: "not permitted", errno.ENAMETOOLONG: "the name is too long",
    errno.ENOTDIR: "a part of the path is no directory", errno.EIO: "the disk has an error",
    errno.EEXIST: "a part of the path is no directory",
}  # fmt: skip
"""Errors of the file system that the user can remedy."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def final(path: Path) -> Path:
    """Return the path that a file has after it is moved out of the hidden directory."""
    return Path(*(part for part in path.parts if not part.startswith(HIDDEN)))


def unwritable(path: Path, error: OSError) -> RuptfxError | None:
    """Return the error of a file or folder with its remedy; None if the user cannot remedy it."""
    if error.errno not in SAID:
        return None
    remedy = "free space or raise the limit" if error.errno in FULL else "change that"
    return RuptfxError(f"{final(path)}: cannot be used: {SAID[error.errno]}; {remedy}, or choose another place")


class Outputs:
    """The files that one command writes into a folder; a context manager that moves them there at its end, or none.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.
    inputs : iterable of Path
        Files that the command reads, which are never replaced.
    overwrite : bool
        Also replace files of the user.
    tell : callable, optional
        Called with the names of the files that are about to be replaced or removed, if there are any.

    Attributes
    ----------
    place : Path
        Directory to write into; everything in it is moved.

    Raises
    ------
    RuptfxError
        A file must not be replaced, or the folder cannot be written. No file is changed then.
    """

    def __init__(
        self, folder: Path, inputs: Iterable[Path] = (), overwrite: bool = False,
        tell: Callable[[list[str]], None] = lambda names: None,
    ) -> None:  # fmt: skip
        self.folder = self.place = folder
        self._inputs, self._overwrite, self._tell = list(inputs), overwrite, tell
        self._claimed = set[str]()
        self._obsolete = set[str]()
        self._created: list[Path] = []

    def __enter__(self) -> Self:
        """Create the folder and the hidden directory in it."""
        try:
            self._created = [each for each in (self.folder, *self.folder.parents) if not each.exists()]
            self.folder.mkdir(parents=True, exist_ok=True)
            _remove_unfinished(self.folder)
            self.place = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=self.folder))
            self._lock = os.open(self.place, os.O_RDONLY)
            with suppress(OSError):  # a file system without locks
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._remove_folders()
            known = unwritable(self.folder, error)
            message = f"{self.folder}: cannot be made ({error.strerror}); choose another --out"
            raise known or RuptfxError(message) from None
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        """Move the files, unless an error occurred."""
        try:
            if error is None:
                self._commit()
        except OSError as late:
            raise unwritable(self.folder, late) or late from None
        finally:
            shutil.rmtree(self.place, ignore_errors=True)
            os.close(self._lock)
            self._remove_folders()
        if isinstance(error, OSError) and (known := unwritable(self.folder, error)):
            raise known from None

    def _remove_folders(self) -> None:
        """Remove the created folders that are empty."""
        with suppress(OSError):
            for each in self._created:
                each.rmdir()

    def claim(self, *names: str) -> Path:
        """Check that files may be written, before they are computed; return the path to write the last one to.

        Raises
        ------
        RuptfxError
        """
        for name in names:
            if name not in self._claimed:
                self._check(name)
                self._claimed.add(name)
        return self.place / names[-1]

    def remove(self, pattern: str) -> None:
        """Remove files of earlier commands whose names match, unless this one writes them; no files of the user."""
        known = _listed(self.folder)
        paths = self.folder.glob(pattern)
        self._obsolete |= {path.name for path in paths if _is_unchanged(path, known.get(path.name))}

    def _check(self, name: str) -> None:
        """Refuse to replace an input, a file of a run, what is no file, and a file of the user without `overwrite`."""
        path = self.folder / name
        if not os.path.lexists(path):
            return
        if any(each.exists() and path.exists() and each.samefile(path) for each in self._inputs):
            raise RuptfxError(f"{path}: is an input of this command; choose another --out")
        run = _run_of(path)
        if run is not None and not path.is_symlink():
            if path.parent.name == FIGURES:
                return
            raise RuptfxError(f"{path}: belongs to the run in {run}; choose another --out")
        if not path.is_symlink() and not path.is_file():
            raise RuptfxError(f"{path}: exists already and is no file; choose another --out, or remove it")
        if self._overwrite or _is_unchanged(path, _listed(self.folder).get(name)):
            return
        what = "is a link" if path.is_symlink() else "exists already, and is not as ruptfx wrote it there"
        raise RuptfxError(f"{path}: {what}; choose another --out, rename it, or replace it with --overwrite")

    def _commit(self) -> None:
        names = [path.relative_to(self.place).as_posix() for path in sorted(self.place.rglob("*")) if path.is_file()]
        for name in names:
            self.claim(name)
        obsolete = self._obsolete - set(names)
        replaced = [name for name in names if os.path.lexists(self.folder / name)] + sorted(obsolete)
        if replaced:
            self._tell(replaced)
        sums = {name: checksum(self.place / name) for name in names}
        with _locked(self.folder):
            # The list is written first: after a kill in between, files of ours count as the user's, not the reverse.
            known = {name: each for name, each in _listed(self.folder).items() if (self.folder / name).is_file()}
            text = json.dumps({"files": {**known, **sums}}, indent=2)
            (self.place / NAME).write_text(text + "\n", encoding="utf-8")
            (self.place / NAME).replace(self.folder / NAME)
            for name in names:
                (self.folder / name).parent.mkdir(exist_ok=True)
                (self.place / name).replace(self.folder / name)
            for name in obsolete:
                (self.folder / name).unlink()


def _run_of(path: Path) -> Path | None:
    """Return the run directory whose list of files has this one; None if there is none."""
    for run in (path.parent, path.parent.parent):
        if path.relative_to(run).as_posix() in (run_files.listed(run) or {}):
            return run
    return None


def _listed(folder: Path) -> dict[str, str]:
    """Return the checksums of the files that commands wrote into a folder; a damaged list is an empty one."""
    try:
        files = json.loads((folder / NAME).read_text(encoding="utf-8"))["files"]
        return {str(name): str(each) for name, each in files.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _is_unchanged(path: Path, expected: str | None) -> bool:
    """Return whether a file is the one that a command wrote."""
    return expected is not None and not path.is_symlink() and path.is_file() and checksum(path) == expected


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Wait for other commands that change the list of this folder."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def _remove_unfinished(folder: Path) -> None:
    """Remove hidden directories of commands that were killed; living ones hold a lock."""
    for path in folder.glob(f"{HIDDEN}*"):
        with suppress(OSError):
            lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path, ignore_errors=True)
            finally:
                os.close(lock)
