"""`files.json`: names of the files that a run wrote, and their checksums once it is complete.

Only listed files are removed when another run replaces this one; other files in the directory belong to the user. A
complete run whose files have other checksums is damaged. Figures and the log have no checksum: they may change
and no result is computed from them.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from ruptfx import RuptfxError, Table
from ruptfx.platform.files import check_unchanged, checksum

NAME = "files.json"
SUMMARY = "summary.json"
CASE = "case.toml"
INPUTS = "inputs.json"
"""Size and sha256 of the files outside of the directory that the run reads; only if the case names some."""
PLUGINS = "plugins"
FREE = ("figures/", "run.log")  # files without checksum
Sums = dict[str, str | None]


class ChangedFileError(RuptfxError):
    """Error of a file that differs from that written by the run; the message names it and the remedy."""


def seal(table: Table) -> str:
    """Return the sha256 of a table of JSON values."""
    return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a name beside a file; what is written there replaces the file in the end, and is removed after an error."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, content: Table) -> None:
    """Write, sync, rename, so that the file is complete at any time."""
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=2)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())


def unfinished(path: Path) -> list[Path]:
    """Return the files that `write_json` left when it was killed before `path` was complete."""
    start = f".{path.name}."
    return [each for each in path.parent.glob(f"{start}*") if each.name.removeprefix(start).isdigit()]


def listed(run: Path) -> Sums | None:
    """Return names and checksums of the files of a run; None without a list.

    Raises
    ------
    ChangedFileError
        If the list is damaged.
    """
    path = run / NAME
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        files = table["files"]
        is_sealed = table["seal"] == seal(files) and all(map(_is_inside, files))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        is_sealed = False
    if not is_sealed:
        raise ChangedFileError(f"{path}: damaged, so its files are not known; run the case into another --out")
    return files


def _is_inside(name: str) -> bool:
    """Return whether a name is that of a file in the directory or one level below it."""
    parts = PurePosixPath(name).parts
    return 0 < len(parts) <= 2 and not name.startswith("/") and not any(part in ("..", ".") for part in parts)


def begin(run: Path, names: Iterable[str]) -> None:
    """List the files that a run is about to write; the existing case and plug-ins get their checksums."""
    files: Sums = {**(listed(run) or {}), **dict.fromkeys(names)}
    for path in (run / CASE, *run.glob(INPUTS), *(run / PLUGINS).glob("*.py")):
        files[path.relative_to(run).as_posix()] = checksum(path)
    _write(run, files)


def add(run: Path, paths: Iterable[Path]) -> None:
    """List further files without checksum."""
    files = listed(run)
    if files is not None:
        _write(run, {**files, **{path.relative_to(run).as_posix(): None for path in paths}})


def complete(run: Path, summary: Table) -> None:
    """Store the checksums of all files of a run and write its summary, which marks it as complete, last."""
    files = listed(run) or {}
    for name in files:
        if (run / name).is_file() and not name.startswith(FREE):
            files[name] = checksum(run / name)
    _write_summary(run, files, summary)


def replace_summary(run: Path, summary: Table) -> None:
    """Replace the summary of a complete run; the checksums of its other files stay."""
    _write_summary(run, listed(run) or {}, summary)


def _write_summary(run: Path, files: Sums, summary: Table) -> None:
    temporary = run / f".{SUMMARY}"
    write_json(temporary, summary)
    _write(run, {**files, SUMMARY: checksum(temporary)})
    temporary.replace(run / SUMMARY)


def _write(run: Path, files: Sums) -> None:
    write_json(run / NAME, {"files": files, "seal": seal(files)})


def check(run: Path, name: str) -> None:
    """Compare a file of a run, and its parts of several ranks, with their checksums.

    The case has its checksum from the beginning, other files from the completion of the run.

    Raises
    ------
    ChangedFileError
    """
    files = listed(run) or {}
    if name != CASE and not (run / SUMMARY).is_file():
        return
    stem, _, suffix = name.rpartition(".")
    for result, expected in files.items():
        of_a_rank = result.startswith(f"{stem}.") and result.endswith(f".{suffix}")
        if result == name or of_a_rank or (name == CASE and (result == INPUTS or result.startswith(f"{PLUGINS}/"))):
            _compare(run / result, expected)


def check_inputs(run: Path) -> bool:
    """Compare the files that a run reads with their checksums at its start.

    Returns
    -------
    bool
        False without checksums: a run of an earlier version, or one that reads no files.

    Raises
    ------
    RuptfxError
        A file was changed or is missing.
    """
    path = run / INPUTS
    if not path.is_file():
        return False
    try:
        sums = dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        raise ChangedFileError(f"{path}: damaged, so the files of the case cannot be compared; run it again") from None
    check_unchanged(sums, run)
    return True


def _compare(path: Path, expected: str | None) -> None:
    if expected is None or not path.is_file() or checksum(path) == expected:
        return
    if path.name in (CASE, INPUTS) or path.parent.name == PLUGINS:
        raise ChangedFileError(
            f"{path}: {path.name} was changed after the run; undo that, or run the changed case into another --out"
        )
    raise ChangedFileError(f"{path}: damaged (its checksum differs from that of the run); run the case again")


def check_all(run: Path) -> list[str]:
    """Return the names of listed files that are missing.

    Raises
    ------
    ChangedFileError
        If an existing file differs from that written by the run.
    """
    files = listed(run) or {}
    for name, expected in files.items():
        _compare(run / name, expected)
    return [name for name, expected in files.items() if expected is not None and not (run / name).is_file()]
