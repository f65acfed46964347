"""What breaks a run, and that nothing is lost: killed, stopped, out of disk, damaged and foreign checkpoints."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import psutil
import pytest
import tomli_w
from helpers.compare import largest_difference
from helpers.small_cases import INSTRUMENTS, impact, merged, plates
from helpers.whole_runs import kill_all

pytest.importorskip("dolfinx")

from ruptfx import __version__
from ruptfx.case import read_case
from ruptfx.platform import run_files
from ruptfx.platform.launch import find_mpiexec
from ruptfx.results import directories
from ruptfx.results.record import Record
from ruptfx.run.recording import checkpoint

CHANGES = {"output.checkpoint_steps": 25, "output.interface_interval": 0.5e-6, "instruments": INSTRUMENTS}
LIMIT = 120  # seconds; a deadlock looks like a slow run


@pytest.fixture(scope="module")
def case_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("case") / "impact.toml"
    path.write_text(tomli_w.dumps(impact(6e6, 2.0, changes=CHANGES)))
    return path


def command(case: Path, out: Path, ranks: int, *options: str) -> list[str]:
    launcher = [find_mpiexec(), "-n", str(ranks)] if ranks > 1 else []
    return [*launcher, sys.executable, "-m", "ruptfx", "run", str(case), "--out", str(out), "--quiet", *options]


def run(case: Path, out: Path, ranks: int = 1, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(case, out, ranks, *options), capture_output=True, text=True, timeout=LIMIT, check=False
    )


@pytest.fixture(scope="module")
def reference(case_file: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Runs that nothing disturbed, by number of ranks."""
    folder = tmp_path_factory.mktemp("reference")
    for ranks in (1, 2):
        done = run(case_file, folder / str(ranks), ranks)
        assert done.returncode == 0, done.stderr
    return {ranks: folder / str(ranks) for ranks in (1, 2)}


def stop_after(case: Path, out: Path, ranks: int, checkpoints: int, number: signal.Signals) -> int:
    """Start a run, send it a signal once it has written some checkpoints; the exit code.

    A run that is over before the signal would test nothing, so that is an error.
    """
    process = subprocess.Popen(
        command(case, out, ranks), start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + LIMIT
    while len(list((out / "checkpoints").glob("step_*"))) < checkpoints and time.monotonic() < deadline:
        assert process.poll() is None, "the run ended before it could be stopped"
        time.sleep(0.005)
    if number == signal.SIGKILL:
        kill_all(process)
    else:
        os.killpg(process.pid, number)
    process.wait(timeout=LIMIT)
    return process.returncode


@pytest.mark.faults
@pytest.mark.parametrize("ranks", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_killed_run_resumes_to_the_same_files(ranks, case_file, reference, tmp_path):
    stop_after(case_file, tmp_path / "run", ranks, 1, signal.SIGKILL)
    with Record(tmp_path / "run") as record:  # readable as it was left
        assert not record.complete and record.interface.sizes["time"] > 0
    done = run(case_file, tmp_path / "run", ranks, "--resume")
    assert done.returncode == 0, done.stderr
    # The state holds every bit that matters, and the files are put back as they were: no difference at all.
    assert max(largest_difference(reference[ranks], tmp_path / "run").values()) == 0


@pytest.fixture(scope="module")
def wall_time(case_file, reference, tmp_path_factory) -> dict[int, float]:
    """Seconds of an undisturbed run whose code is compiled, by number of ranks."""
    seconds = {}
    for ranks in reference:
        began = time.monotonic()
        run(case_file, tmp_path_factory.mktemp("timed") / "run", ranks)
        seconds[ranks] = time.monotonic() - began
    return seconds


@pytest.mark.faults
@pytest.mark.slow
@pytest.mark.parametrize("trial", range(12))
def test_killed_at_random_times(trial, case_file, reference, wall_time, tmp_path):
    ranks, chance = 1 + trial % 2, random.Random(trial)
    out, kills, longest = tmp_path / "run", [], wall_time[ranks]
    while len(kills) < 3:
        process = subprocess.Popen(
            command(case_file, out, ranks, "--resume"), start_new_session=True, stderr=subprocess.PIPE
        )
        began = time.monotonic()
        try:
            _, said = process.communicate(timeout=chance.uniform(0.05, 1.0) * longest)
        except subprocess.TimeoutExpired:
            kill_all(process)
            process.communicate(timeout=LIMIT)
            kills.append(max((path.name[5:] for path in (out / "checkpoints").glob("step_*")), default="none"))
        else:  # faster than it was timed, on a machine with other work: once more from the beginning
            assert process.returncode == 0, said
            longest = time.monotonic() - began
            shutil.rmtree(out)
    done = run(case_file, out, ranks, "--resume")
    assert done.returncode == 0, done.stderr
    assert max(largest_difference(reference[ranks], out).values()) == 0
    print(f"ranks {ranks}: killed with the newest checkpoint at step {', '.join(kills)}")


@pytest.mark.faults
def test_resumes_on_another_number_of_ranks(case_file, reference, tmp_path):
    stop_after(case_file, tmp_path / "run", 2, 1, signal.SIGKILL)
    done = run(case_file, tmp_path / "run", 3, "--resume")
    assert done.returncode == 0, done.stderr
    # Sums over elements come in another order: round-off, which 350 steps amplify little.
    assert max(largest_difference(reference[1], tmp_path / "run").values()) < 1e-10


@pytest.mark.faults
@pytest.mark.parametrize("number", [
    signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow),
    pytest.param(signal.SIGUSR1, marks=pytest.mark.slow), pytest.param(signal.SIGXCPU, marks=pytest.mark.slow),
])  # fmt: skip
def test_signals_write_a_checkpoint_first(number, case_file, reference, tmp_path):
    assert stop_after(case_file, tmp_path / "run", 1, 1, number) == 130
    newest = max((tmp_path / "run" / "checkpoints").glob("step_*"))
    step = Record(reference[1]).summary["time_step"]
    with Record(tmp_path / "run") as record:
        assert not record.complete
        # The checkpoint is younger than the last record, by less than one record interval (0.5 us) and the step that
        # tractions are behind.
        assert 0 <= int(newest.name[5:]) * step - float(record.interface.time[-1]) < 0.51e-6 + step
    assert run(case_file, tmp_path / "run", 1, "--resume").returncode == 0
    assert max(largest_difference(reference[1], tmp_path / "run").values()) == 0


@pytest.mark.faults
def test_a_resumed_case_that_cannot_run_loses_nothing(case_file, tmp_path):
    """Begun before its first checkpoint, and refused by the model now: the old records stay."""
    table = tomllib.loads(case_file.read_text())
    table["boundaries"][0]["edge"] = "upper.nowhere"
    broken, out = tmp_path / "broken.toml", tmp_path / "run"
    broken.write_text(tomli_w.dumps(table))
    out.mkdir()
    (out / "case.toml").write_text(read_case(broken).to_toml())
    (out / "interface.h5").write_text("records")
    done = run(broken, out, 1, "--resume")
    assert done.returncode == 1 and "upper.nowhere" in done.stderr
    assert (out / "interface.h5").read_text() == "records"


@pytest.mark.faults
def test_resume_before_the_first_checkpoint_begins_again(case_file, reference, tmp_path):
    out = tmp_path / "run"
    out.mkdir()
    (out / "case.toml").write_text((reference[1] / "case.toml").read_text())
    (out / "interface.h5").write_bytes(b"cut in the middle of its first")
    assert run(case_file, out, 1, "--resume").returncode == 0
    assert max(largest_difference(reference[1], out).values()) == 0


@pytest.fixture
def killed(case_file: Path, tmp_path: Path) -> Path:
    """A run with two checkpoints that was killed."""
    stop_after(case_file, tmp_path / "run", 1, 2, signal.SIGKILL)
    return tmp_path / "run"


def flip_a_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.faults
def test_damaged_checkpoint_gives_way_to_the_one_before(killed, case_file, reference):
    flip_a_byte(max((killed / "checkpoints").glob("step_*")) / "state.h5")
    assert run(case_file, killed, 1, "--resume").returncode == 0
    assert max(largest_difference(reference[1], killed).values()) == 0


@pytest.mark.faults
def test_damaged_checkpoints_are_refused(killed, case_file):
    for folder in (killed / "checkpoints").glob("step_*"):
        flip_a_byte(folder / "state.h5")
    done = run(case_file, killed, 1, "--resume")
    assert done.returncode == 1
    assert "checksum differs" in done.stderr and "state.h5" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.faults
def test_checkpoint_of_another_case_is_refused(killed, case_file):
    done = run(case_file, killed, 1, "--resume", "--set", "duration=19e-6")
    assert done.returncode == 1
    assert "holds a run of case" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.faults
def test_no_byte_of_a_checkpoint_can_change_unnoticed(killed):
    (killed / "summary.json").unlink(missing_ok=True)
    folder, chance = max((killed / "checkpoints").glob("step_*")), random.Random(0)
    case = read_case(killed / "case.toml")
    checkpoint._verified(folder, case)
    for path in sorted(folder.iterdir()):
        whole = path.read_bytes()
        for place in (0, len(whole) - 2, *(chance.randrange(len(whole)) for _ in range(8))):
            damaged = bytearray(whole)
            damaged[place] ^= 1 << chance.randrange(8)
            path.write_bytes(damaged)
            with pytest.raises(checkpoint.CheckpointError, match=r"damaged|does not match|belongs to"):
                checkpoint._verified(folder, case)
        path.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(checkpoint.CheckpointError):
            checkpoint._verified(folder, case)
        path.write_bytes(whole)
    checkpoint._verified(folder, case)


@pytest.mark.faults
@pytest.mark.parametrize("change, message", [
    ({"ruptfx_version": "0.0.1"}, f"written by ruptfx 0.0.1, this is {__version__}"),
    pytest.param({"layout": 1}, "written by another revision", marks=pytest.mark.slow),
])  # fmt: skip
def test_checkpoint_of_another_version_is_refused(change, message, killed, case_file):
    for folder in (killed / "checkpoints").glob("step_*"):
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest.pop("seal")
        manifest |= change
        (folder / "manifest.json").write_text(json.dumps({**manifest, "seal": checkpoint._seal(manifest)}))
    done = run(case_file, killed, 1, "--resume")
    assert done.returncode == 1
    assert message in done.stderr and "Traceback" not in done.stderr


@pytest.mark.faults
def test_a_rank_that_dies_ends_all_and_nothing_is_lost(case_file, reference, tmp_path):
    out = tmp_path / "run"
    process = subprocess.Popen(command(case_file, out, 2), stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    deadline = time.monotonic() + LIMIT
    while not list((out / "checkpoints").glob("step_*")) and time.monotonic() < deadline:
        time.sleep(0.005)
    ranks = [p for p in psutil.Process(process.pid).children(recursive=True) if "ruptfx" in " ".join(p.cmdline())]
    ranks[-1].kill()
    began = time.monotonic()
    process.communicate(timeout=LIMIT)
    assert process.returncode != 0 and time.monotonic() - began < 20
    assert run(case_file, out, 2, "--resume").returncode == 0
    assert max(largest_difference(reference[2], out).values()) == 0


@pytest.mark.slow
@pytest.mark.faults
def test_ranks_end_with_their_launcher(case_file, tmp_path, monkeypatch):
    """Killed, `ruptfx run --ranks 2` takes mpiexec and its ranks with it, and leaves nothing in the temp directory."""
    out, temporary = tmp_path / "run", tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    long = ["--set", "duration=2e-3", "--ranks", "2"]  # 110 times as long: it cannot be over before
    process = subprocess.Popen(command(case_file, out, 1, *long), stderr=subprocess.PIPE)
    deadline = time.monotonic() + LIMIT
    while not list((out / "checkpoints").glob("step_*")) and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.005)
    family = psutil.Process(process.pid).children(recursive=True)
    assert sum("ruptfx" in " ".join(each.cmdline()) for each in family) >= 3  # mpiexec and two ranks
    process.kill()
    gone, left = psutil.wait_procs(family, timeout=30)
    for each in left:
        each.kill()
    process.communicate(timeout=LIMIT)
    assert left == [] and len(gone) == len(family)
    assert list(temporary.iterdir()) == []


@pytest.mark.faults
def test_complete_run_is_not_run_again(case_file, reference):
    before = (reference[1] / "summary.json").stat().st_mtime_ns
    assert run(case_file, reference[1], 1, "--resume").returncode == 0
    assert (reference[1] / "summary.json").stat().st_mtime_ns == before


@pytest.mark.faults
def test_complete_run_of_another_case_is_not_handed_out(case_file, reference):
    done = run(case_file, reference[1], 1, "--resume", "--set", "duration=19e-6")
    assert done.returncode == 1
    asked = read_case(case_file, ["duration=19e-6"]).hash
    assert f"holds a run of case {Record(reference[1]).summary['case_hash']}, this is case {asked}" in done.stderr
    assert "--out" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.faults
@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_second_resume_at_the_same_time_is_refused(ranks, case_file, reference, tmp_path):
    out = tmp_path / "run"
    first = subprocess.Popen(command(case_file, out, 1), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + LIMIT
    while not list((out / "checkpoints").glob("step_*")) and time.monotonic() < deadline:
        time.sleep(0.005)
    first.send_signal(signal.SIGSTOP)  # so that it is not over before the second has looked
    try:
        second = run(case_file, out, ranks, "--resume")
    finally:
        first.send_signal(signal.SIGCONT)
    assert second.returncode == 1
    assert f"in use by process {first.pid} on " in second.stderr and "Traceback" not in second.stderr
    _, said = first.communicate(timeout=LIMIT)
    assert first.returncode == 0, said
    assert max(largest_difference(reference[1], out).values()) == 0
    assert not (out / directories.LOCK).exists()


@pytest.mark.faults
def test_full_disk_is_a_clear_error_and_keeps_the_checkpoint(case_file, reference, tmp_path):
    out = tmp_path / "run"

    # No file may grow beyond 0.7 MB: writing then fails as on a full disk. Set after MPI has made its own files.
    program = (
        "import resource, signal, sys; from ruptfx.platform import fem; fem.MPI; from ruptfx.app.cli import app; "
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (700_000, 700_000)); "
        "app(sys.argv[1:])"
    )
    arguments = command(case_file, out, 1)[3:]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert done.returncode == 1, done.stderr
    assert "cannot be written" in done.stderr
    assert "ruptfx/" not in done.stderr  # HDF5 may complain of its own objects, but no traceback is ours
    assert list((out / "checkpoints").glob("step_*"))
    assert run(case_file, out, 1, "--resume").returncode == 0
    assert max(largest_difference(reference[1], out).values()) == 0


# -- longer runs and replaced ones -----------------------------------------------------------------------------------

EVERY = {"output.interface_interval": 0.5e-6, "output.bulk_interval": 10e-6, "output.figures": False}
LEAPFROG = impact(6e6, 2.0, changes={"instruments": INSTRUMENTS, **EVERY})
AGEING = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6}
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
ADAPTIVE = plates({
    "order": 2, "faults.main.friction": AGEING, "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6},
    "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "boundaries": [*HELD, {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1e-6}],
    "stepper": {"kind": "quasi_static", "radiation_damping": True, "first_step": 1e-3, "largest_step": 0.2},
    "output.interface_interval": 0.1, "output.bulk_interval": 1.0, "output.figures": False,
})  # fmt: skip
QUASI_DYNAMIC = {**ADAPTIVE, "stepper": {"kind": "quasi_dynamic", "first_step": 1e-3, "largest_step": 0.2}}
SAME_SUMS = {"stepper.petsc_options": {"pc_type": "redundant"}}
"""Factorisation of the whole matrix on every rank. MUMPS on two ranks adds in the order of messages: the same run twice
differs by 1e-13."""
MINE = {"notes.txt": "mine", "export/slip.csv": "mine", "figures/slip.pdf": "mine"}
"""What a user has put into a run directory."""


def written(path: Path, table: dict[str, Any], duration: float) -> Path:
    path.write_text(tomli_w.dumps(merged(table, {"duration": duration})))
    return path


def extend(out: Path, duration: float, ranks: int = 1) -> subprocess.CompletedProcess[str]:
    asked = [sys.executable, "-m", "ruptfx", "resume", str(out), "--duration", repr(duration), "--ranks", str(ranks)]
    return subprocess.run([*asked, "--quiet"], capture_output=True, text=True, timeout=LIMIT, check=False)


def add_mine(out: Path) -> None:
    for name, text in MINE.items():
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text(text)


# Case, unit of time, and what two ranks may differ by.
EXTENDED = {
    "leapfrog": (LEAPFROG, 1e-6, 0.0),
    "adaptive": (ADAPTIVE, 0.1, 1e-10),
    "adaptive with the same sums": (merged(ADAPTIVE, SAME_SUMS), 0.1, 0.0),
    "quasi-dynamic": (QUASI_DYNAMIC, 0.1, 1e-12),
}


def assert_mine(out: Path) -> None:
    assert {name: (out / name).read_text() for name in MINE} == MINE


@pytest.mark.faults
@pytest.mark.parametrize("name, ranks", [
    ("leapfrog", 1), *(pytest.param(name, 1, marks=pytest.mark.slow) for name in EXTENDED if name != "leapfrog"),
    *(pytest.param(name, 2, marks=pytest.mark.slow) for name in EXTENDED),
])  # fmt: skip
def test_a_finished_run_is_extended_from_its_end(name, ranks, tmp_path):
    """From 40 to 60 units of time: the same bits as a run of 60; it has written no checkpoint but that of its end."""
    table, unit, on_two_ranks = EXTENDED[name]
    out, whole = tmp_path / "run", tmp_path / "whole"
    done = run(written(tmp_path / "short.toml", table, 40 * unit), out, ranks)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (out / "checkpoints").iterdir()] == ["final"]
    with Record(out) as record:
        steps = record.summary["steps"]
    add_mine(out)
    done = extend(out, 60 * unit, ranks)
    assert done.returncode == 0, done.stderr
    assert run(written(tmp_path / "long.toml", table, 60 * unit), whole, ranks).returncode == 0
    assert max(largest_difference(whole, out).values()) <= (0.0 if ranks == 1 else on_two_ranks)
    assert_mine(out)
    assert not (out / directories.NEW).exists()
    with Record(out) as one, Record(whole) as other:
        assert one.summary["steps"] == other.summary["steps"] > steps
        assert one.interface.attrs["complete"] == 1
    assert sum("nodes" in line for line in (out / "run.log").read_text().splitlines()) == 2  # it did go on
    assert run_files.check_all(out) == []


@pytest.mark.slow
@pytest.mark.faults
def test_a_run_without_checkpoint_is_not_extended(tmp_path):
    """Nothing of it is touched, and the command that is named computes the longer run."""
    out = tmp_path / "run"
    assert run(written(tmp_path / "case.toml", LEAPFROG, 4e-6), out).returncode == 0
    add_mine(out)
    shutil.rmtree(out / "checkpoints")
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    done = extend(out, 6e-6)
    assert done.returncode == 1 and "no checkpoint" in done.stderr
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    remedy = done.stderr[done.stderr.index("ruptfx run") :].split()
    again = subprocess.run(
        [sys.executable, "-m", *remedy, "--quiet"], capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert again.returncode == 0, again.stderr
    with Record(tmp_path / "run-longer") as record:
        assert record.case["duration"] == 6e-6 and record.complete


def kill_in(out: Path, asked: list[str]) -> None:
    """Start a command that replaces the run in a directory, and kill it at its first checkpoint."""
    process = subprocess.Popen(asked, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline, before = time.monotonic() + LIMIT, None
    while time.monotonic() < deadline:
        found = {path.name for path in (out / directories.NEW / "checkpoints").glob("step_*")}
        if before is not None and found - before:
            break
        before = found if (out / directories.NEW / "run.log").exists() and before is None else before
        assert process.poll() is None, "the run ended before it could be stopped"
        time.sleep(0.002)
    kill_all(process)
    process.wait(timeout=LIMIT)


@pytest.mark.faults
@pytest.mark.parametrize("ranks, how", [
    (1, "overwrite"),
    *(pytest.param(*each, marks=pytest.mark.slow) for each in ((2, "overwrite"), (1, "extension"), (2, "extension"))),
])  # fmt: skip
def test_a_finished_run_is_there_until_the_next_one_is_complete(how, ranks, case_file, reference, tmp_path):
    out, case = tmp_path / "run", tmp_path / "case.toml"
    shutil.copytree(reference[1], out)
    add_mine(out)
    # Extended, a run keeps the interval of its snapshots: a sixth of 18 us.
    table = merged(tomllib.loads(case_file.read_text()), {"duration": 30e-6, "output.bulk_interval": 3e-6})
    case.write_text(tomli_w.dumps(table))
    python = [sys.executable, "-m", "ruptfx"]
    asked = {
        "overwrite": [*python, "run", str(case), "--out", str(out), "--overwrite", "--ranks", str(ranks), "--quiet"],
        "extension": [*python, "resume", str(out), "--duration", "30e-6", "--ranks", str(ranks), "--quiet"],
    }
    kill_in(out, asked[how])
    # The former run is as it was, and says so.
    assert max(largest_difference(reference[1], out).values()) == 0
    with Record(out) as record:
        assert record.complete and record.case["duration"] == 18e-6
    assert run_files.check_all(out) == []
    assert run(case_file, out, 1, "--resume").returncode == 0  # it is complete: nothing happens
    assert (out / directories.NEW).is_dir()
    # What was interrupted is gone on with.
    done = subprocess.run(
        [*python, "resume", str(out), "--ranks", str(ranks), "--quiet"],
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    whole = tmp_path / "whole"
    assert run(case, whole, ranks).returncode == 0
    if how == "overwrite" or ranks == 1:
        assert max(largest_difference(whole, out).values()) == 0
    else:  # the former run was of one rank: sums come in another order
        assert max(largest_difference(whole, out).values()) < 1e-10
    assert_mine(out)
    assert not (out / directories.NEW).exists() and run_files.check_all(out) == []
