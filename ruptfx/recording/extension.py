"""A run made longer: its checkpoints become those of the same case with a longer duration."""

from __future__ import annotations

from pathlib import Path

from ruptfx import RuptfxError, directories
from ruptfx.case import Case
from ruptfx.recording import checkpoint


def extend(out: Path, before: Case, longer: Case) -> Case:
    """Let a run, finished or not, go on to a longer duration; without a checkpoint it will begin again.

    Records go on in the intervals they had. Stopped half-way, this may be repeated.

    Parameters
    ----------
    out : Path
        Run directory.
    before, longer : Case
        The case of the directory, and the same with another duration.

    Returns
    -------
    Case
        What the directory holds now.

    Raises
    ------
    RuptfxError
        The duration is not longer, or another run writes there.
    """
    if longer.duration <= before.duration:
        raise RuptfxError(
            f"--duration {longer.duration:g}: {out} has {before.duration:g} s already; give a longer one, or resume "
            "without it"
        )
    output = before.output
    intervals = {
        "interface_interval": output.interface_interval or before.duration / 300,
        "bulk_interval": output.bulk_interval or before.duration / 6,
    }
    case = longer.model_copy(update={"output": output.model_copy(update=intervals)})
    with directories.reserved(out):
        for path in checkpoint.all_of(out):
            manifest = checkpoint.read_manifest(path)
            if manifest["case_hash"] == before.hash:
                checkpoint.write_manifest(path, {**manifest, "case_hash": case.hash})
        (out / "summary.json").unlink(missing_ok=True)
        case.save(out)
    return case
