"""A run directory from somebody else: going on with it writes nowhere else."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.small_cases import case

from ruptfx import RuptfxError, simulate
from ruptfx.run.recording.checkpoint import CheckpointError

pytestmark = pytest.mark.fem
KEPT = "precious"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "run"
    simulate(case({"duration": 1e-6, "output.checkpoint_steps": 10}), out, progress=False).close()
    return out


@pytest.fixture
def stopped(finished: Path, tmp_path: Path) -> Path:
    """The same run, stopped after its last checkpoint, in a home directory with a file that must not change."""
    out = tmp_path / "home" / "runs" / "stopped"
    shutil.copytree(finished, out)
    (out / "summary.json").unlink()
    (tmp_path / "home" / "notes.txt").write_text(KEPT)
    return out


def resume(out: Path) -> None:
    simulate(case({"duration": 1e-6, "output.checkpoint_steps": 10}), out, progress=False, resume=True).close()


def checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def forge(out: Path, change: Callable[[Path, dict[str, Any]], None]) -> None:
    """Change all checkpoints, and seal them as anybody can."""
    for folder in (out / "checkpoints").glob("step_*"):
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest.pop("seal")
        change(folder, manifest)
        manifest["seal"] = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()
        (folder / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.parametrize("absolute", [False, True])
def test_names_in_a_manifest_lead_nowhere_else(absolute: bool, stopped: Path) -> None:
    notes = stopped.parents[1] / "notes.txt"
    name = str(notes) if absolute else "../../notes.txt"  # beside the run directory, one folder above runs/

    def change(folder: Path, manifest: dict[str, Any]) -> None:
        source = folder / name  # the checkpoint's own file of that name, with a checksum that is right
        if not absolute:
            source.write_text("replaced")
        manifest["files"][name] = checksum(source)

    forge(stopped, change)
    before = sorted(path.name for path in stopped.iterdir())
    with pytest.raises(CheckpointError, match=facts(r"notes\.txt.* elsewhere")):
        resume(stopped)
    assert notes.read_text() == KEPT
    assert sorted(path.name for path in stopped.iterdir()) == before


@pytest.mark.parametrize("way", ["link", "raw", "virtual"])
def test_histories_that_keep_data_elsewhere_are_refused(way: str, stopped: Path) -> None:
    """HDF5 would write records through an external link, into a raw file or into the source of a virtual data set."""
    notes = stopped.parents[1] / "notes.txt"
    if way != "raw":
        with h5py.File(notes, "w") as file:
            file.create_dataset("values", (100,), float)
    kept = notes.read_bytes()

    def change(folder: Path, manifest: dict[str, Any]) -> None:
        path = folder / "interface.h5"
        with h5py.File(path, "a") as file:
            del file["peak_slip_rate"]
            if way == "link":
                file["peak_slip_rate"] = h5py.ExternalLink(str(notes), "values")
            elif way == "raw":
                file.create_dataset("peak_slip_rate", (100,), float, external=[(str(notes), 0, h5py.h5f.UNLIMITED)])
            else:
                layout = h5py.VirtualLayout((100,), float)
                layout[:] = h5py.VirtualSource(str(notes), "values", (100,))
                file.create_virtual_dataset("peak_slip_rate", layout)
        manifest["files"]["interface.h5"] = checksum(path)

    forge(stopped, change)
    with pytest.raises(CheckpointError, match="peak_slip_rate"):
        resume(stopped)
    assert notes.read_bytes() == kept


@pytest.mark.parametrize("name", ["run.log", "interface.h5", ".lock", "bulk.h5"])
def test_links_out_of_a_run_directory_are_refused(name: str, stopped: Path) -> None:
    notes = stopped.parents[1] / "notes.txt"
    (stopped / name).unlink(missing_ok=True)
    (stopped / name).symlink_to(notes)
    with pytest.raises(RuptfxError, match=facts(rf"{name}: a link to .*notes\.txt")):
        resume(stopped)
    assert notes.read_text() == KEPT


def test_links_within_a_run_directory_are_its_own_matter(stopped: Path) -> None:
    (stopped / "newest").symlink_to(max((stopped / "checkpoints").iterdir()))
    resume(stopped)
    assert (stopped / "summary.json").is_file()
