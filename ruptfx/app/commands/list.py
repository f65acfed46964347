"""`ruptfx list`."""

from __future__ import annotations

import fcntl
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG
from typing import Annotated

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import reported, screen

HEADING = "Post-process"


def list(
    directory: Annotated[Path, typer.Argument(help="Folder that contains run directories.")] = Path("runs"),
    quick: Annotated[bool, typer.Option("--quick", help="Do not compare files with their checksums.")] = False,
) -> None:
    """List the runs below a directory: status, sliding mode, newest checkpoint, size; check their files.

    Example: ruptfx list runs --quick
    """
    with reported():
        from ruptfx.results.directories import NEW

        found = sorted(path.parent for path in directory.rglob("case.toml") if NEW not in path.parts)
        if not found:
            raise RuptfxError(f"{directory}: no runs below it; give the directory that holds them")
        table = Table("run", "status", "mode", "checkpoint", "size", "title", box=None, pad_edge=False)
        damages = []
        for run in found:
            row, damage = _row(run, quick)
            table.add_row(str(run), *row)
            damages += [damage] * bool(damage)
        screen.print(table)
        for damage in damages:
            screen.print(damage, soft_wrap=True, markup=False, highlight=False)


def _row(run: Path, quick: bool) -> tuple[tuple[str, str, str, str, str], str]:
    """Return the cells of a run, and the text of its damage."""
    from ruptfx.platform import run_files
    from ruptfx.results.record import Record

    summary, title, status, damage = None, "", "", ""
    try:
        record = Record(run)
        summary, title = record.summary, str(record.case.get("title", ""))
        status = _status(run, summary is not None)
        missing = [] if quick or summary is None else run_files.check_all(run)
        status += f", {', '.join(missing)} missing" if missing else ""
    except (RuptfxError, OSError) as error:
        status, damage = "damaged", str(error)
    mode = str((summary or {}).get("mode") or "")
    mode += f" ({summary['interface']})" if mode and summary and "interfaces" in summary else ""
    return (status, mode, _newest(run), f"{_size(run) / 1e6:.1f} MB", title), damage


def _newest(run: Path) -> str:
    """Return the step of the newest checkpoint, from which an incomplete run can be resumed."""
    steps = [path.name.removeprefix("step_") for path in run.glob("checkpoints/step_*")]
    return f"step {max(numbers)}" if (numbers := [int(step) for step in steps if step.isdecimal()]) else ""


def _size(run: Path) -> int:
    """Return the bytes of all files; hard links count once."""
    found = {}
    for path in run.rglob("*"):
        with suppress(OSError):  # removed by another process
            status = path.lstat()
            found[status.st_dev, status.st_ino] = status.st_size if S_ISREG(status.st_mode) else 0
    return sum(found.values())


def _status(run: Path, complete: bool) -> str:
    from ruptfx.results.directories import LOCK, NEW

    replaced = (run / NEW / "case.toml").is_file()
    try:
        with (run / LOCK).open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return "complete, being replaced" if complete and replaced else "complete" if complete else "running"
    except OSError:
        pass
    return "complete, its replacement stopped" if complete and replaced else "complete" if complete else "stopped"
