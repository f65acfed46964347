"""Run of one point of a study, on a worker."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import tomli_w

from ruptfx import RuptfxError, Table
from ruptfx.many_runs.jobs import children
from ruptfx.many_runs.study.store import Result, commit, read_result, workspace

SERVER = "ruptfx.many_runs.study.case_server"


def run_point(path: str, point: str, table: Table, keep: list[str], ranks: int, time_limit: float | None) -> Result:
    """Run one point and mark it as finished; a failure is stored as its result.

    Runs on a worker, which sees the directory of the study under the same path.

    Raises
    ------
    RuptfxError
        If the study is stopping, or its directory is missing.
    """
    folder = Path(path)
    if (known := read_result(folder, point)) is not None:
        return known
    try:
        directory = workspace(folder, point)
    except OSError as error:
        message = f"{folder}: a worker cannot write there ({error.strerror}): is it on a shared file system?"
        raise RuptfxError(message) from None
    began = time.perf_counter()
    _save_case(table, directory)
    try:
        job: Table = {"case": table, "directory": str(directory), "keep": keep}
        result = children.on_child(SERVER, ranks, job, time_limit)
    except children.ChildError as error:
        result = {"status": "failed", "error": str(error)}
    if children.are_closing() or result["status"] == "interrupted":
        shutil.rmtree(directory, ignore_errors=True)
        raise RuptfxError(result.get("error", "the study is stopping"))
    return commit(folder, point, directory, {**result, "seconds": time.perf_counter() - began})


def _save_case(table: Table, directory: Path) -> None:
    """Write the case of a point, for a separate run; its plug-ins are those of the study."""
    named = [os.path.relpath(path, directory) for path in table.get("plugins", [])]
    full_table = {**table, "plugins": named} if named else table
    (directory / "case.toml").write_text(tomli_w.dumps(full_table), encoding="utf-8")
