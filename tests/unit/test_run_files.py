"""Files of a run: checksums that show every damage, directories that hide no other, and replacement at any moment."""

from __future__ import annotations

import json
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import Result
from helpers import synthetic
from helpers.messages import facts, says
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.platform import run_files
from ruptfx.results import directories
from ruptfx.results.record import Files, Record, RecordError

DEMOS = Path(__file__).parents[2] / "demos"
NAMES = ("interface.h5", "bulk.h5", "instruments.h5", "energy.csv", "run.log")


def ruptfx(*arguments: str | Path) -> Result:
    return CliRunner(env={"COLUMNS": "250"}).invoke(app, [str(argument) for argument in arguments])


def write_run(path: Path) -> Path:
    """A complete run with checksums."""
    time, position = synthetic.times(31), synthetic.points(20)
    synthetic.write_run(path, synthetic.crack(time, position), time, position, complete=False)
    run_files.begin(path, NAMES)
    run_files.complete(path, {"mode": "crack"})
    return path


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return write_run(tmp_path / "runs" / "one")


READ = {
    "interface.h5": lambda record: record.interface, "bulk.h5": lambda record: record.bulk,
    "instruments.h5": lambda record: record.instruments, "energy.csv": lambda record: record.energy,
    "case.toml": lambda record: record.case, "summary.json": lambda record: record.summary,
}  # fmt: skip


@pytest.mark.parametrize("kind", [Files, Record])
@pytest.mark.parametrize("name", READ)
def test_no_bit_of_a_complete_run_can_change_unnoticed(name: str, kind: type[Files], run: Path) -> None:
    path, chance = run / name, random.Random(1)
    whole = path.read_bytes()
    for _ in range(50):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        with kind(run) as record, pytest.raises(RecordError, match=facts(name)):
            READ[name](record)
    for part in (0.99, 0.5, 0.1):
        path.write_bytes(whole[: int(part * len(whole))])
        with kind(run) as record, pytest.raises(RecordError, match=facts(name)):
            READ[name](record)
    path.write_bytes(whole)
    with kind(run) as record:
        READ[name](record)


def test_parts_of_several_ranks_are_compared_with_the_whole(run: Path) -> None:
    (run / "bulk.1.h5").write_bytes(b"part")
    run_files.begin(run, ["bulk.1.h5"])
    run_files.complete(run, {"mode": "crack"})
    (run / "bulk.1.h5").write_bytes(b"pArt")
    with Record(run) as record, pytest.raises(RecordError, match=r"bulk\.1\.h5"):
        _ = record.bulk


def test_a_case_that_was_edited_is_called_so(run: Path) -> None:
    with (run / "case.toml").open("a") as file:
        file.write("\n[more]\n")
    with pytest.raises(RecordError, match=facts(r"case\.toml was changed after the run")):
        _ = Record(run).case
    # Also of a run that was stopped, and where it is resumed.
    (run / "summary.json").unlink()
    with pytest.raises(RecordError, match=facts(r"case\.toml was changed after the run")):
        _ = Record(run).case
    said = " ".join(ruptfx("resume", run).output.split())
    assert says("case.toml was changed after the run", said)


@pytest.mark.usefixtures("blank_pictures")
def test_what_the_user_adds_or_draws_again_is_no_damage(run: Path) -> None:
    (run / "notes.txt").write_text("mine")
    (run / "mine").mkdir()
    with (run / "run.log").open("a") as file:
        file.write("my remark\n")
    assert ruptfx("plot", run).exit_code == 0
    run_files.add(run, (run / "figures").glob("*.png"))
    assert ruptfx("plot", run, "--format", "png", "--format", "svg").exit_code == 0
    assert run_files.check_all(run) == []
    assert " complete " in ruptfx("list", run.parent).output


def test_a_run_of_before_there_were_checksums_is_read_as_it_was(run: Path) -> None:
    (run / run_files.NAME).unlink()
    with (run / "case.toml").open("a") as file:
        file.write("\n[more]\n")
    with Record(run) as record:
        assert record.complete and record.case["more"] == {} and record.interface.sizes["time"] == 31


@pytest.mark.parametrize("content", ["", "{}", "[]", "3", '{"files": 3, "seal": ""}', b"\xff\xfe"])
def test_a_damaged_list_is_an_error_that_names_it(content: str | bytes, run: Path) -> None:
    (run / run_files.NAME).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RecordError, match=r"files\.json"):
        _ = Record(run).summary
    assert "damaged" in ruptfx("list", run.parent).output


# -- damaged directories -------------------------------------------------------------------------------------------


def damage(run: Path, how: str) -> None:
    """One of the ways in which a directory without checksums can be broken."""
    (run / run_files.NAME).unlink()
    if how == "step_foo":
        (run / "checkpoints" / "step_foo").mkdir(parents=True)
    elif how == "summary":
        (run / "summary.json").write_text("3")
    elif how == "column":
        (run / "energy.csv").write_text("time,a\n")
    elif how == "encoding":
        (run / "energy.csv").write_bytes(b"# \xff\xfe\ntime,closure\n")
    elif how == "case":
        (run / "case.toml").write_bytes(b"\xff\xfe")


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("how", ["step_foo", "summary", "column", "encoding", "case"])
def test_one_bad_directory_hides_no_other(how: str, run: Path) -> None:
    good = write_run(run.with_name("two"))
    damage(run, how)
    listed = ruptfx("list", run.parent)
    assert listed.exit_code == 0 and str(good) in listed.output and str(run) in listed.output
    assert ("damaged" in listed.output) == (how in ("summary", "case"))
    for result in (ruptfx("plot", run), ruptfx("compare", run, good, "--out", run.parent / "both.png")):
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    drawn = ruptfx("plot", run)
    if how in ("column", "encoding"):
        assert drawn.exit_code == 1 and "energy.csv" in drawn.output and "cannot be saved" not in drawn.output


def test_list_compares_all_files_unless_in_a_hurry(run: Path) -> None:
    data = bytearray((run / "bulk.h5").read_bytes())
    data[len(data) // 2] ^= 1
    (run / "bulk.h5").write_bytes(data)
    assert "damaged" in ruptfx("list", run.parent).output and "bulk.h5" in ruptfx("list", run.parent).output
    assert "damaged" not in ruptfx("list", run.parent, "--quick").output
    (run / "bulk.h5").unlink()
    assert says("complete, bulk.h5 missing", ruptfx("list", run.parent).output)


# -- replacement -----------------------------------------------------------------------------------------------------

OLD = {"case.toml": "old", "energy.csv": "old", "forces.csv": "old", "figures/a.png": "old"}
FRESH = {"case.toml": "new", "energy.csv": "new", "edges.csv": "new", "plugins/law.py": "new"}
MINE = ("notes.txt", "export/data.csv", "figures/mine.pdf", "checkpoints/mine.txt")


def fill(out: Path, files: dict[str, str], step: int) -> None:
    for name, text in {**files, f"checkpoints/step_{step:08d}/state.h5": "state"}.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(text)
    run_files.begin(out, [name for name in files if name != "case.toml"])
    run_files.complete(out, {"case_hash": next(iter(files.values()))})


@pytest.fixture
def both(tmp_path: Path) -> Path:
    """A run directory with files of the user's, and a complete run that is to replace the one there."""
    out = tmp_path / "run"
    fill(out, OLD, 10)
    for name in MINE:
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("mine")
    fill(out / directories.NEW, FRESH, 20)
    return out


def assert_replaced(out: Path) -> None:
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    state = "checkpoints/step_00000020/state.h5"
    assert files == {*FRESH, *MINE, state, "summary.json", run_files.NAME}
    assert {(out / name).read_text() for name in FRESH} == {"new"}
    assert {(out / name).read_text() for name in MINE} == {"mine"}
    assert run_files.check_all(out) == []


def test_a_run_is_replaced_and_what_is_not_of_it_stays(both: Path) -> None:
    directories.end_replacement(both)
    assert_replaced(both)


def test_killed_at_any_moment_of_a_replacement(both: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Either run is complete, or the directory says that it is not; the next command brings it to its end."""
    begin, moment, killed = both.with_name("begin"), 0, True
    both.rename(begin)
    while killed:
        shutil.rmtree(both, ignore_errors=True)
        shutil.copytree(begin, both)
        left = moment

        def counted(call):
            def change(*args, **options):
                nonlocal left
                left -= 1
                if left < 0:
                    raise KeyboardInterrupt
                return call(*args, **options)

            return change

        with monkeypatch.context() as patched:
            for name in ("replace", "unlink", "rmdir", "mkdir"):
                patched.setattr(Path, name, counted(getattr(Path, name)))
            patched.setattr(shutil, "rmtree", counted(shutil.rmtree))
            try:
                directories.replace(both)
                killed = False
            except KeyboardInterrupt:
                killed = True
        if (both / "summary.json").exists():
            run_files.check_all(both)  # raises if it is a mixture of both
            whole = OLD if json.loads((both / "summary.json").read_text())["case_hash"] == "old" else FRESH
            assert [name for name in whole if not (both / name).is_file()] == []
        directories.end_replacement(both)
        shutil.rmtree(both / directories.NEW, ignore_errors=True)  # after the last change, an empty one may be left
        assert_replaced(both)
        moment += 1
    assert moment > 12


def test_a_file_of_the_users_with_a_name_of_the_new_run_is_kept(both: Path) -> None:
    (both / "edges.csv").write_text("mine")
    directories.end_replacement(both)
    assert (both / "edges.csv").read_text() == "new" and (both / "edges.csv.kept").read_text() == "mine"


@pytest.mark.parametrize("name", ["../precious", "/precious", "a/../../precious", "a/b/c"])
def test_names_in_a_list_lead_nowhere_else(name: str, both: Path) -> None:
    (both.parent / "precious").write_text("mine")
    files = {**(run_files.listed(both) or {}), name: None}
    (both / run_files.NAME).write_text(json.dumps({"files": files, "seal": run_files.seal(files)}))
    with pytest.raises(RuptfxError, match=r"files\.json"):
        directories.end_replacement(both)
    assert (both.parent / "precious").read_text() == "mine"


# -- scripts ---------------------------------------------------------------------------------------------------------


def run_script(folder: Path, *lines: str) -> subprocess.CompletedProcess[str]:
    script = "\n".join(["from ruptfx import RuptfxError", "from ruptfx.app.script import begin", *lines])
    return subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False)


def test_a_script_checks_its_outputs_first_and_shows_errors_in_one_line(run: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "old" / "case.toml").parent.mkdir()
    (tmp_path / "old" / "case.toml").write_text("title = 'of a run that left no list'")
    for output in ("file/run", "old"):
        done = run_script(tmp_path, f"begin({output!r})", "print('computes')")
        assert done.returncode == 1 and done.stdout == "" and done.stderr.startswith(f"error: {output}: ")
        assert done.stderr.count("\n") == 1
    done = run_script(tmp_path, f"begin({str(run)!r}, 'new/run')", "raise RuptfxError('key: value, bound, remedy')")
    assert (done.returncode, done.stderr) == (1, "error: key: value, bound, remedy\n")
    assert "Traceback" in run_script(tmp_path, "begin()", "1 / 0").stderr  # a bug still shows where it is


@pytest.mark.parametrize("demo", sorted(DEMOS.glob("*.py")), ids=lambda path: path.stem)
def test_demo_scripts_begin_so_and_can_run_twice(demo: Path) -> None:
    text = demo.read_text()
    assert re.search(r"^begin\(.+\)$", text, re.MULTILINE)
    if "simulate" in text and "mkdtemp" not in text:
        calls = re.findall(r"(?<!\w)simulate\(.*", text)
        assert calls and all("overwrite=True" in call for call in calls)


def test_folders_of_the_user_among_checkpoints_stay(tmp_path: Path) -> None:
    for name in ("step_00000010/state.h5", "final/state.h5", "mine/notes.txt"):
        path = tmp_path / directories.CHECKPOINTS / name
        path.parent.mkdir(parents=True)
        path.write_text("x")
    directories._remove_checkpoints(tmp_path)
    files = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()]
    assert files == ["checkpoints/mine/notes.txt"]
