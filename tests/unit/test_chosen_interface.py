"""Figures, movies, comparisons and forces are of the interface of a choice where a run has several."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers import synthetic
from helpers.messages import facts
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.app.commands.compare import overlay
from ruptfx.results import plots
from ruptfx.results.record import Record, RecordError

TIME, POSITION = synthetic.times(), synthetic.points()


def write(path: Path, decisive: str = "main") -> Path:
    """Two interfaces; everything on the branch is twice as fast, and its forces are twice those of the other one."""
    synthetic.write_run(path, np.maximum(synthetic.crack(TIME, POSITION), 0), TIME, POSITION)
    for name in ("branch", "main"):
        shutil.copy(path / "interface.h5", path / f"interface_{name}.h5")
        with h5py.File(path / f"interface_{name}.h5", "a") as file:
            file.attrs["fault"] = name
            file["slip_rate"][...] *= 2 if name == "branch" else 1
        (path / f"forces_{name}.csv").write_text(f"time,shear_force\n0.0,0.0\n1e-6,{2 if name == 'branch' else 1}\n")
    (path / "interface.h5").unlink()
    summary = json.loads((path / "summary.json").read_text()) if (path / "summary.json").is_file() else {}
    (path / "summary.json").write_text(json.dumps({**summary, "interface": decisive}))
    (path / "files.json").unlink(missing_ok=True)
    return path


def largest(record: Record) -> float:
    return float(np.abs(record.interface["slip_rate"].values).max())


def test_the_interface_of_a_choice(tmp_path: Path) -> None:
    with Record(write(tmp_path / "run")) as record, record.on("branch") as branch:
        assert (record.interface_name, branch.interface_name) == ("main", "branch")
        assert largest(branch) == 2 * largest(record) > 0
        assert [float(each.forces["shear_force"].values[-1]) for each in (record, branch)] == [1.0, 2.0]
        with branch.between(0.0, TIME[5]) as part:
            assert part.interface_name == "branch" and part.interface.sizes["time"] == 6
        with pytest.raises(RecordError, match=facts("interface 'branhc': .*branch")):
            record.on("branhc")
        labels = [plots.space_time(each, field="slip_rate").get_xlabel() for each in (record, branch)]
        assert labels == ["Position on main (mm)", "Position on branch (mm)"]
        assert plots.slip_profiles(branch, field="slip").get_xlabel() == "Position on branch (mm)"


def test_one_interface_has_no_name_in_labels(tmp_path: Path) -> None:
    synthetic.write_run(tmp_path / "run", np.maximum(synthetic.crack(TIME, POSITION), 0), TIME, POSITION)
    with Record(tmp_path / "run") as record:
        assert plots.space_time(record, field="slip_rate").get_xlabel() == "Position along the interface (mm)"


def test_commands_show_the_interface_of_a_choice(tmp_path: Path) -> None:
    run = write(tmp_path / "run")
    for command, made in (
        (["plot", str(run), "--figure", "space_time", "--interface", "branch"], "space_time_branch.png"),
        (["movie", str(run), "--what", "slip_rate", "--frames", "2", "--interface", "branch"], "slip_rate_branch.gif"),
    ):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, result.output
        assert {path.name for path in (run / "figures").iterdir()} >= {made}
    assert not (run / "figures" / "space_time.png").exists()
    for command in (["plot", str(run)], ["compare", str(run), str(run), "--out", str(tmp_path / "both.png")]):
        result = CliRunner().invoke(app, [*command, "--interface", "branhc"])
        assert result.exit_code == 1 and "branch" in result.output


def test_two_runs_are_compared_on_the_same_interface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The interface with the largest slip of the second run is another one: that of the first run decides."""
    seen = []

    def drawn(*both: Record) -> object:
        seen.append([record.interface_name for record in both])
        return overlay(*both)

    monkeypatch.setattr("ruptfx.app.commands.compare.overlay", drawn)
    runs = [str(write(tmp_path / "a", "main")), str(write(tmp_path / "b", "branch"))]
    for option in ([], ["--interface", "branch"]):
        result = CliRunner().invoke(app, ["compare", *runs, "--out", str(tmp_path / "both.png"), *option])
        assert result.exit_code == 0, result.output
    assert seen == [["main", "main"], ["branch", "branch"]]
