"""The directory of a study: one lock, one identity, one directory per finished point.

A point is finished when its directory exists under its final name ``points/HASH``: it is filled under another name
and renamed. Unfinished directories of a killed study are removed by the next one.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from ruptfx import RuptfxError, Table
from ruptfx.many_runs.study.definition import Study
from ruptfx.platform import run_files
from ruptfx.platform.run_files import write_json
from ruptfx.results.directories import LOCK, reserved

Result = Table


class Store:
    """The directory of a study; a context manager that holds its lock.

    Parameters
    ----------
    overwrite : bool
        Replace another study; points that both have are kept.

    Raises
    ------
    RuptfxError
        If another process uses the directory, or it contains another study or other files.
    """

    def __init__(self, path: str | Path, study: Study, overwrite: bool = False) -> None:
        self.path, self._study, self._overwrite = Path(path).absolute(), study, overwrite
        self.points = self.path / "points"

    def __enter__(self) -> Self:
        """Lock the directory and remove unfinished points."""
        marker = self.path / "study.json"
        unfinished = run_files.unfinished(marker)
        known = {self.path / LOCK, self.points, *unfinished}
        strangers = [path.name for path in self.path.glob("*") if path not in known]
        if strangers and not marker.is_file():
            raise RuptfxError(f"{self.path}: holds something else ({strangers[0]}); choose another --out")
        with ExitStack() as stack:
            stack.enter_context(reserved(self.path))
            self.points.mkdir(exist_ok=True)
            self._claim(marker)
            for file in unfinished:
                file.unlink(missing_ok=True)
            for leftover in self.points.glob(".*"):
                shutil.rmtree(leftover, ignore_errors=True)
            self._held = stack.pop_all()
        return self

    def _claim(self, marker: Path) -> None:
        """Check that the directory belongs to this study, or mark it."""
        mine = self._study.identity()
        if marker.is_file():
            theirs = json.loads(marker.read_text())["identity"]
            remedy = "choose another --out, or replace it with --overwrite (in Python overwrite=True)"
            if theirs != mine and self._overwrite:
                kept = {point.hash for point in self._study.points()}
                for path in self.points.iterdir():
                    if path.name not in kept:
                        shutil.rmtree(path)
            elif theirs["axes"] != mine["axes"]:
                raise RuptfxError(
                    f"{self.path}: holds another study, with axes {', '.join(theirs['axes'])} "
                    f"instead of {', '.join(mine['axes'])}; {remedy}"
                )
            elif theirs != mine:
                raise RuptfxError(
                    f"{self.path}: holds another study: the case differs in keys that are no axes; {remedy}"
                )
        write_json(marker, {"identity": mine, "study": self._study.model_dump(mode="json", exclude_none=True)})

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def result(self, point: str) -> Result | None:
        """Return the result of a finished point, None if it is not finished."""
        return read_result(self.path, point)

    @property
    def finished(self) -> int:
        """Number of finished points."""
        return sum(not path.name.startswith(".") for path in self.points.iterdir())

    def forget_failures(self) -> int:
        """Remove failed points, so that they run again; return their number."""
        results = self.points.glob("*/result.json")
        failed = [path.parent for path in results if json.loads(path.read_text())["status"] == "failed"]
        for directory in failed:
            shutil.rmtree(directory)
        return len(failed)


def workspace(path: Path, point: str) -> Path:
    """Create a new empty directory in which a point runs."""
    directory = path / "points" / f".{point}-{os.getpid()}-{time.monotonic_ns()}"
    directory.mkdir()
    return directory


def commit(path: Path, point: str, directory: Path, result: Result) -> Result:
    """Mark a point as finished, atomically: write the result and give the directory its final name.

    The line in ``points.log`` follows the rename: a point that is run twice has two lines.
    """
    write_json(directory / "result.json", result)
    try:
        directory.rename(path / "points" / point)
    except OSError:
        # Another process finished the same point first; equal input gives equal output.
        shutil.rmtree(directory, ignore_errors=True)
    with (path / "points.log").open("a") as log:
        log.write(f"{time.strftime('%Y-%m-%dT%H:%M:%S')} {point} {result['status']}\n")
    return result


def read_result(path: Path, point: str) -> Result | None:
    """Return the result of a point, None if it is not finished."""
    try:
        result: Result = json.loads((path / "points" / point / "result.json").read_text())
    except FileNotFoundError:
        return None
    return result
