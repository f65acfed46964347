"""Files that a case names: the checks before one is opened, and checksums of those that a resumed run reads again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, cast

from ruptfx import RuptfxError

Sums = dict[str, list[int | str] | None]
"""Size and sha256 of files by absolute path; None where there is no file."""

REMEDY = "give a file with numbers"


def checksum(path: Path) -> str:
    """Return the sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_file(path: Path, most: int | None = None, kind: str = "files with numbers", remedy: str = REMEDY) -> Path:
    """Return the path of a regular file; every reader of a file of a case calls this before it opens the file.

    Parameters
    ----------
    most : int, optional
        Largest size in bytes.
    kind, remedy : str
        Kind of such files and the remedy, for messages.

    Raises
    ------
    ValueError
        There is no such file, it is a directory, a device or a pipe, or too large.
    """
    try:
        if path.exists() and not path.is_file():
            raise ValueError(f"{path}: cannot be read: it is no regular file; {remedy}")
        size = path.stat().st_size
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}); correct its name; {remedy}") from None
    if most is not None and size > most:
        raise ValueError(f"{path}: has {size / 1e6:.0f} MB, and {kind} at most {most / 1e6:.0f}; {remedy}")
    return path


def identity(path: Path) -> list[int | str] | None:
    """Return size and sha256 of a file; None where there is no regular file."""
    try:
        state = path.stat()
        return list(_identity(path, state.st_size, state.st_mtime_ns, state.st_ino)) if path.is_file() else None
    except OSError:
        return None


def read_once[Reader: Callable[..., Any]](read: Reader) -> Reader:
    """Decorate a function that reads a file: it is called again where the file or another argument has changed."""

    @lru_cache(maxsize=8)
    def remembered(file: str, _: tuple[int, int, int] | None, *others: Any, **named: Any) -> Any:
        return read(file, *others, **named)

    @wraps(read)
    def reading(file: str, *others: Any, **named: Any) -> Any:
        try:
            state = Path(file).stat()
        except OSError:  # the reader says why
            return read(file, *others, **named)
        return remembered(file, (state.st_size, state.st_mtime_ns, state.st_ino), *others, **named)

    return cast("Reader", reading)


@lru_cache(maxsize=256)
def _identity(path: Path, size: int, modified: int, number: int) -> tuple[int, str]:
    return size, checksum(path)


def check_unchanged(sums: Sums, run: Path) -> None:
    """Compare files with their checksums of an earlier time.

    Parameters
    ----------
    run : Path
        Directory of what was computed from the files then, for messages.

    Raises
    ------
    RuptfxError
        A line for each file that was changed or is missing.
    """
    problems = []
    for name, before in sums.items():
        now = identity(Path(name))
        if now != before and before is not None:
            problems.append(
                f"{name}: {'missing' if now is None else 'changed'} since {run} was begun with it (sha256 {before[1]}, "
                f"{before[0]} bytes" + (f"; now {now[1]}, {now[0]} bytes" if now else "") + "); put the former file "
                "there again, or run the case with the new one into another --out"
            )
    if problems:
        raise RuptfxError("\n".join(problems))
