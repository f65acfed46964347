"""`ruptfx list`."""

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen


def list(
    directory: Annotated[Path, typer.Argument(help="Where run directories are.")] = Path("runs"),
) -> None:
    """The runs below a directory: status, sliding mode, newest checkpoint, size.

    Example: ruptfx list runs
    """
    with reported():
        found = sorted(path.parent for path in directory.rglob("case.toml"))
        if not found:
            raise RuptfxError(f"{directory}: no runs below it; give the directory that holds them")
        table = Table("run", "status", "mode", "checkpoint", "size", "title", box=None, pad_edge=False)
        for run in found:
            table.add_row(str(run), *_row(run))
        screen.print(table)


def _row(run: Path) -> tuple[str, str, str, str, str]:
    from ruptfx.record import Record, RecordError

    record = Record(run)
    try:
        summary, title = record.summary, str(record.case.get("title", ""))
    except RecordError:
        summary, title = None, "damaged"
    checkpoints = sorted(run.glob("checkpoints/step_*"))
    step = f"step {int(checkpoints[-1].name.removeprefix('step_'))}" if checkpoints else ""
    size = sum(path.stat().st_size for path in run.rglob("*") if path.is_file())
    mode = str((summary or {}).get("mode") or "")
    return _status(run, summary is not None), mode, step, f"{size / 1e6:.1f} MB", title


def _status(run: Path, complete: bool) -> str:
    if complete:
        return "complete"
    try:
        with (run / ".lock").open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return "running"
    except OSError:
        pass
    return "stopped"
