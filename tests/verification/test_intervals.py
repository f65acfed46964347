"""Intervals of output: those that are asked for, whatever the duration, also of a run that is made longer."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
from helpers.crack_cases import block
from helpers.sliding_cases import rough
from helpers.small_cases import INSTRUMENTS, case, plates
from typer.testing import CliRunner

pytest.importorskip("dolfinx")

from helpers.messages import facts

import ruptfx
from ruptfx.app.checks.preflight import preflight
from ruptfx.app.cli import app
from ruptfx.case import Case, parse_case, read_case, read_toml
from ruptfx.input.schema import CaseError
from ruptfx.lumped import LumpedModel
from ruptfx.run import simulation
from ruptfx.run.recording.checkpoint import Checkpoints, all_of, read_manifest, write_manifest
from ruptfx.run.recording.recorder import Recorder
from ruptfx.run.recording.schedule import Schedule, count, end_of
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem
STEP = 1e-7


def times(changes: dict[str, Any], folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times of records and of snapshots of a run of 2 us in steps of 0.1 us."""
    given = case({"order": 2, "duration": 2e-6, "stepper.time_step": STEP, **changes})
    with simulate(given, folder, progress=False) as record:
        return record.interface.time.values, record.bulk.time.values


def test_the_interval_asked_for_is_kept(tmp_path: Path) -> None:
    """2 us are 2.86 of 0.7 us and 1.33 of 1.5 us: records at the multiples, and at the end."""
    records, snapshots = times({"output.interface_interval": 0.7e-6, "output.bulk_interval": 1.5e-6}, tmp_path / "run")
    # Steps end at the multiples of 0.1 us, and so do the intervals; a snapshot is half a step later.
    np.testing.assert_allclose(records, [0.0, 0.7e-6, 1.4e-6, 2.0e-6], atol=1e-3 * STEP)
    np.testing.assert_allclose(snapshots, np.array([1.5e-6, 2.0e-6]) + 0.5 * STEP, atol=1e-3 * STEP)


def test_an_interval_longer_than_the_run(tmp_path: Path) -> None:
    records, snapshots = times({"output.interface_interval": 1.0, "output.bulk_interval": 2.8e-6}, tmp_path / "run")
    np.testing.assert_allclose(records, [0.0, 2e-6], atol=1e-3 * STEP)
    np.testing.assert_allclose(snapshots, [2e-6 + 0.5 * STEP], atol=1e-3 * STEP)


@pytest.mark.parametrize("key", ["output.interface_interval", "output.bulk_interval", "instruments"])
def test_a_tiny_interval_is_refused(key: str) -> None:
    """5 us hold 5e10 intervals of 1e-16 s; the bound is 1e7 of them, 5e-13 s, and what the message says is accepted."""
    receiver = {"kind": "receiver", "name": "a", "interval": 1e-16, "point": [5e-3, 2e-3]}
    tiny, name = ([receiver], "instruments.0.interval") if key == "instruments" else (1e-16, key)
    with pytest.raises(CaseError, match=facts(rf"{name} = 1e-16 s: 5e\+10 records")) as caught:
        case({key: tiny, "duration": 5e-6})
    least = float(str(caught.value).split("give at least ")[1].split(" s")[0])
    assert 5e-13 < least < 5.2e-13
    case({key: [{**receiver, "interval": least}] if key == "instruments" else least, "duration": 5e-6})


def test_a_tiny_interval_of_means_is_refused() -> None:
    with pytest.raises(CaseError, match=r"output.forces_interval = 1e-16 s"):
        parse_case(rough({"output.forces_interval": 1e-16}))


def test_check_tells_how_many_records_there_will_be(tmp_path: Path) -> None:
    changes = {"output.interface_interval": 0.7e-6, "output.bulk_interval": 1.5e-6}
    found = {row.quantity: row.value for row in preflight(case({"duration": 2e-6, **changes}))}
    records, snapshots = times(changes, tmp_path / "run")
    assert (found["records: interface"], found["records: bulk"]) == (len(records), len(snapshots)) == (4, 2)


def demos() -> dict[str, Case]:
    folder, found = Path(ruptfx.__file__).with_name("demos"), {}
    for path in sorted(folder.glob("*.toml")):
        if "axes" not in read_toml(path) and not isinstance(given := read_case(path), LumpedModel):
            found[path.stem] = given
    return found


def test_demos_whose_duration_is_a_multiple_have_the_records_they_had() -> None:
    """Before, N = round(duration / interval) records were duration / N apart, early by 1e-9 of the duration."""
    multiples = 0
    for given in demos().values():
        for what, interval in given.intervals.items():
            number = round(given.duration / interval)
            if abs(given.duration / interval - number) > 1e-6:
                continue
            multiples += 1
            expected = np.linspace(0, given.duration, number + 1)
            assert count(interval, given.duration) == number, what
            schedule, slack = Schedule(interval), 1e-9 * given.duration
            for each, time in enumerate(expected):
                assert schedule.due(each, time) and not schedule.due(each, time * (1 - 2e-9) - 1e-300)
                assert schedule.after(time) == each + 1 and schedule.after(time - 2 * slack) <= max(each, 0)
    assert multiples > 20


def test_multiples_and_the_end() -> None:
    # 0.3 is not three times 0.1 in binary: rounding adds no record.
    assert [count(0.1, 0.3), count(0.1, 0.30001), count(0.4, 0.3), count(14.0, 20.0)] == [3, 4, 1, 2]
    schedule = Schedule(0.1)
    assert schedule.due(3, 0.3) and schedule.after(0.3) == 4 and schedule.after(0.95) == 10  # several at once
    assert end_of(0.3) < 0.3 < end_of(0.30001)


CASES: dict[str, dict[str, Any]] = {
    "split": plates({"instruments": INSTRUMENTS[:1], "boundaries": [
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0},
    ]}),
    "slides": rough(),
    "means": rough({"output.forces_interval": 0.36e-6}),
    "breaks": block(),
}  # fmt: skip


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name in ("means", "breaks"))) for name in CASES
])  # fmt: skip
def test_a_longer_run_has_the_records_of_one_run_over_the_whole_time(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Extended from a checkpoint at its end, whose files have the record of that end, which is no multiple."""
    short, long = (5e-6, 9e-6) if name == "breaks" else (0.8e-6, 2e-6)
    output = CASES[name]["output"] | {"interface_interval": 0.3 * short, "bulk_interval": 0.45 * short}
    table = {**CASES[name], "output": {**output, "checkpoint_steps": 10**6}}
    whole, before = (parse_case({**table, "duration": duration}) for duration in (long, short))
    assert isinstance(whole, Case) and isinstance(before, Case)
    simulate(whole, tmp_path / "whole", progress=False).close()
    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        made: list[Checkpoints] = []
        patch.setattr(simulation, "Checkpoints", lambda *given: made.append(Checkpoints(*given)) or made[-1])
        finish = Recorder.finish

        def saves(recorder: Recorder, state: Any) -> None:
            made[-1].write(state)
            finish(recorder, state)

        patch.setattr(Recorder, "finish", saves)
        with simulate(before, run, progress=False) as record:
            # 0.3, 0.6 and 0.9 of the duration, the start and the end.
            assert record.energy.sizes["time"] == 5
    (folder,) = [path for path in all_of(run) if path.name != "final"]
    manifest = read_manifest(folder)
    for file in sorted(run.iterdir()):  # the files as they are now, with that record
        if file.name in manifest["files"]:
            shutil.copyfile(file, folder / file.name)
            manifest["files"][file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    longer = tmp_path / "longer"
    shutil.copytree(folder, longer / "checkpoints" / folder.name)
    whole.save(longer)
    write_manifest(longer / "checkpoints" / folder.name, {**manifest, "case_hash": whole.hash})
    simulate(whole, longer, progress=False, resume=True).close()
    histories = sorted(path.name for path in (tmp_path / "whole").iterdir() if path.suffix in (".h5", ".csv"))
    assert histories == sorted(path.name for path in longer.iterdir() if path.suffix in (".h5", ".csv"))
    for file in histories:
        if file.endswith(".csv"):
            assert (longer / file).read_bytes() == (tmp_path / "whole" / file).read_bytes(), file
            continue
        one, other = (arrays(folder / file) for folder in (tmp_path / "whole", longer))
        assert one.keys() == other.keys()
        assert [key for key in one if not same(one[key], other[key])] == [], file


def arrays(path: Path) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def same(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def test_resume_with_a_longer_duration(tmp_path: Path) -> None:
    """The command: 0.8 us with records every 0.3 us, made 2 us long, has the records of a run of 2 us."""
    output = {"figures": False, "interface_interval": 0.3e-6, "bulk_interval": 0.45e-6}
    runs = {"whole": 2e-6, "longer": 0.8e-6}
    for name, duration in runs.items():
        (tmp_path / f"{name}.toml").write_text(tomli_w.dumps(plates({"duration": duration, "output": output})))
        command = ["run", str(tmp_path / f"{name}.toml"), "--out", str(tmp_path / name), "--quiet"]
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, done.output
    done = CliRunner().invoke(app, ["resume", str(tmp_path / "longer"), "--duration", "2 us", "--quiet"])
    assert done.exit_code == 0, done.output
    for file in ("interface.h5", "bulk.h5"):
        one, other = (arrays(tmp_path / name / file) for name in runs)
        assert [key for key in one if not same(one[key], other[key])] == [], file
    assert (tmp_path / "whole" / "energy.csv").read_bytes() == (tmp_path / "longer" / "energy.csv").read_bytes()
