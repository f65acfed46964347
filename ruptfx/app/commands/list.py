"""`ruptfx list`."""

from __future__ import annotations

import fcntl
import json
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG
from typing import Annotated

import typer
from rich.table import Column, Table

from ruptfx import RuptfxError
from ruptfx import Table as Tables
from ruptfx.app.commands._shared import reported, screen, table_console

HEADING = "Post-process"


def list(
    directory: Annotated[Path, typer.Argument(help="Folder that contains run directories.")] = Path("runs"),
    quick: Annotated[bool, typer.Option("--quick", help="Do not compare files with their checksums.")] = False,
) -> None:
    """List the runs and studies below a directory: status, mode, newest checkpoint, size; check the files of runs.

    A study is one row with the number of its points; kept runs of points are listed with its folder points.

    Example: ruptfx list runs --quick
    """
    with reported():
        from ruptfx.results.directories import NEW

        studies = [path.parent for path in directory.rglob("study.json") if (path.parent / "points").is_dir()]
        of_studies = {study / "points" for study in studies}
        items = sorted(path.parent for path in directory.rglob("case.toml")
                       if NEW not in path.parts and of_studies.isdisjoint(path.parents))  # fmt: skip
        if not items and not studies:
            raise RuptfxError(f"{directory}: no runs below it; give the directory that holds them")
        first = Column("run", overflow="fold")
        table = Table(first, "status", "mode", "checkpoint", "size", "title", box=None, pad_edge=False)
        for study in sorted(studies):
            table.add_row(str(study), *_study_row(study))
        damages = []
        for run in items:
            row, damage = _row(run, quick)
            table.add_row(str(run), *row)
            damages += [damage] * bool(damage)
        table_console().print(table)
        for damage in damages:
            screen.print(damage, soft_wrap=True, markup=False, highlight=False)


def _study_row(study: Path) -> tuple[str, str, str, str, str]:
    """Return the cells of a study: its finished and failed points."""
    results = [_json(path) for path in (study / "points").glob("[!.]*/result.json")]
    failed = sum(result.get("status") == "failed" for result in results)
    status = f"study, {len(results)} points" + f", {failed} failed" * bool(failed) + ", running" * _in_use(study)
    title = str(_json(study / "study.json").get("study", {}).get("title", ""))
    return status, "", "", f"{_size(study) / 1e6:.1f} MB", title


def _json(path: Path) -> Tables:
    """Return the table of a JSON file, empty if it is damaged."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


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
    entries = {}
    for path in run.rglob("*"):
        with suppress(OSError):  # removed by another process
            status = path.lstat()
            entries[status.st_dev, status.st_ino] = status.st_size if S_ISREG(status.st_mode) else 0
    return sum(entries.values())


def _status(run: Path, complete: bool) -> str:
    from ruptfx.results.directories import NEW

    replaced = (run / NEW / "case.toml").is_file()
    if _in_use(run):
        return "complete, being replaced" if complete and replaced else "complete" if complete else "running"
    return "complete, its replacement stopped" if complete and replaced else "complete" if complete else "stopped"


def _in_use(directory: Path) -> bool:
    """Return whether a process holds the lock of a run or a study."""
    from ruptfx.results.directories import LOCK

    try:
        with (directory / LOCK).open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    return False
