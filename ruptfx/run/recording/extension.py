"""Runs made longer: the same case with a longer duration, continued from a checkpoint of the former run."""

from __future__ import annotations

import os
import shlex
import shutil
from pathlib import Path

from ruptfx import RuptfxError
from ruptfx.case import Case
from ruptfx.platform import run_files
from ruptfx.platform.files import checksum
from ruptfx.results import directories
from ruptfx.run.recording import checkpoint


def extend(out: Path, before: Case, longer: Case) -> Case:
    """Prepare a longer run in the `.new` of a run directory, to be resumed from the newest checkpoint there.

    The run in the directory, finished or not, is unchanged until the longer one is complete. Records continue in
    their previous intervals. A longer run that was stopped can be made longer in turn.

    Parameters
    ----------
    out : Path
        Run directory.
    before, longer : Case
        The case that `resume` would continue, and the same with another duration.

    Returns
    -------
    Case
        The longer case, to be resumed.

    Raises
    ------
    RuptfxError
        The duration is not longer, there is no checkpoint, the run was changed, or another run writes there.
    """
    source = directories.unfinished(out)
    if source != out and longer.duration == before.duration:
        return before
    if longer.duration <= before.duration:
        raise RuptfxError(
            f"--duration {longer.duration:g}: {out} has {before.duration:g} s already; give a longer one, or resume "
            "without it"
        )
    intervals = {f"{what}_interval": interval for what, interval in before.intervals.items()}
    case = longer.model_copy(update={"output": before.output.model_copy(update=intervals)})
    directories.refuse_links(out)
    run_files.check_inputs(source)
    with directories.reserved(out):
        paths = checkpoint.all_of(source)
        if (source / run_files.SUMMARY).is_file():
            paths += filter(Path.is_dir, [source / checkpoint.FOLDER / directories.FINAL])
        result = checkpoint.newest(paths, before)
        if result is None:
            raise RuptfxError(
                f"{out}: has no checkpoint to go on from; run its case from the beginning: "
                f"ruptfx run {shlex.quote(str(out / run_files.CASE))} --out {shlex.quote(f'{out}-longer')} "
                f"--set duration={longer.duration!r}"
            )
        path, manifest = result
        place = directories.renew(out / ".part")
        copy = place / checkpoint.FOLDER / f"step_{manifest['step']:08d}"
        copy.mkdir(parents=True)
        histories = manifest.pop("histories", [])
        for name in histories:
            run_files.check(source, name)
        for file in (*(path / name for name in manifest["files"]), *(source / name for name in histories)):
            _link(file, copy / file.name)
        sums = {name: checksum(copy / name) for name in histories}
        files = {**manifest["files"], **sums}
        checkpoint.write_manifest(copy, {**manifest, "case_hash": case.hash, "files": files, "histories": []})
        if (source / "run.log").is_file():
            shutil.copyfile(source / "run.log", place / "run.log")
        case.save(place)
        run_files.begin(place, [])
        shutil.rmtree(out / directories.NEW, ignore_errors=True)
        place.replace(out / directories.NEW)
    return case


def _link(source: Path, target: Path) -> None:
    """Create a hard link, as both files are final; a copy if the file system has no links."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
