"""What a run of all benchmarks ends with: which checks failed, and that times do not decide there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.messages import facts, says
from PIL import Image

import ruptfx.app.bench
from ruptfx import RuptfxError
from ruptfx.app.bench import CORE, Check, benchmarks, checkout_folder, run_benchmark, verdict
from ruptfx.app.bench._parts import ratio
from ruptfx.case import Case, read_case

OTHERS = Path(__file__).parents[1] / "benchmarks"

BENCHMARKS = {
    "slow_one": 'return [Check("speed", 3.0, 3.0), Check("step", 0.5, 0.8, 0, "s", "aim", "at most", timing=True)]',
    "wrong_one": 'return [Check("angle", 70.0, 81.5, 0.1, "deg", "a paper", relative=True)]',
    "broken_one": 'raise ValueError("no such mesh")',
    "fine_one": 'return [Check("slip", 1.0, 1.0)]',
}


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Only these benchmarks, in files of their own."""
    folder = tmp_path / f"of_{tmp_path.name}"  # modules are known by the name of their folder
    folder.mkdir()
    for name, result in BENCHMARKS.items():
        (folder / f"{name}.py").write_text(
            f'"""An example."""\nfrom ruptfx.app.bench import Check\n\n\ndef run(fine, comm):\n    {result}\n'
        )
    files = {name: folder / f"{name}.py" for name in BENCHMARKS}
    monkeypatch.setattr(ruptfx.app.bench, "benchmarks", lambda folder: files)
    return tmp_path


def test_all_ends_with_the_checks_that_failed(known: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not run_benchmark("all", out=known / "out")
    assert capsys.readouterr().out.splitlines()[-5:] == [
        "times that were missed and do not decide here: 1",
        "slow_one: step: found 0.8, expected 0.5 s, tolerance at most (aim)",
        "checks that failed: 2 of 5",
        "wrong_one: angle: found 81.5, expected 70 deg, tolerance 10 % (a paper)",
        "broken_one: ran to its end: found nan, expected 1, tolerance 0 (ValueError: no such mesh)",
    ]
    assert {path.stem for path in (known / "out").glob("*.json")} == set(BENCHMARKS)  # those after it ran, too


def test_figures_are_drawn_in_the_common_style(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thick line of the first colour, drawn without any style: #0072b2 in the middle of the panel."""
    folder = tmp_path / f"of_{tmp_path.name}"
    folder.mkdir()
    (folder / "drawn.py").write_text(
        '"""An example."""\nfrom ruptfx.app.bench import Check, Outcome\n'
        "from ruptfx.results.figure_style import new_figure\n\n\n"
        "def draw():\n    figure, ((ax,),) = new_figure(1, 1, 1, 2)\n"
        "    ax.plot([0, 1], [0.5, 0.5], lw=200)\n    return figure\n\n\n"
        'def run(fine, comm):\n    return Outcome([Check("slip", 1.0, 1.0)], draw)\n'
    )
    monkeypatch.setattr(ruptfx.app.bench, "benchmarks", lambda _: {"drawn": folder / "drawn.py"})
    assert run_benchmark("drawn", out=tmp_path / "out")
    pixels = np.asarray(Image.open(tmp_path / "out" / "drawn.png").convert("RGB"))
    assert tuple(pixels[90, 220]) == (0x00, 0x72, 0xB2)


@pytest.mark.slow  # and `make bench`, which runs all of them so
def test_benchmarks_run_at_the_same_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    # Real ones, of the package and of the checkout: the processes that run them import them by themselves.
    names = ["waves", "plane_waves"]
    files = {name: benchmarks(OTHERS)[name] for name in names}
    monkeypatch.setattr(ruptfx.app.bench, "benchmarks", lambda folder: files)
    found = {}
    for jobs in (1, 2):
        assert run_benchmark("all", as_json=True, out=tmp_path / str(jobs), jobs=jobs)
        rows = json.loads(capsys.readouterr().out)
        assert list(rows) == names
        found[jobs] = [(row["quantity"], row["passed"], row["found"]) for name in names for row in rows[name]]
    for here, apart in zip(found[1], found[2], strict=True):
        assert here[:2] == apart[:2] and here[2] == pytest.approx(apart[2], rel=1e-9, abs=1e-12)
    assert len(list((tmp_path / "2").glob("*.json"))) == 2


def test_some_benchmarks_are_left_out_of_all(known: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of four, one breaks down and one misses a check that decides."""
    assert run_benchmark("all", out=known / "out", without=["broken_one", "wrong_one"])
    said = capsys.readouterr().out
    assert "broken_one" not in said and "wrong_one" not in said and "fine_one" in said
    for name, without, message in (("all", "fine_ones", "fine_one"), ("fine_one", "slow_one", "leave out --without")):
        with pytest.raises(RuptfxError, match=facts(f"--without {without}: .*{message}")):
            run_benchmark(name, out=known / "out", without=[without])


def test_times_decide_where_a_benchmark_is_run_by_its_name(known: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert not run_benchmark("slow_one", out=known / "out")
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "checks that failed: 1 of 2", "slow_one: step: found 0.8, expected 0.5 s, tolerance at most (aim)",
    ]  # fmt: skip
    assert run_benchmark("fine_one", out=known / "out")
    assert capsys.readouterr().out.splitlines()[-1] == "checks that failed: 0 of 1"
    with pytest.raises(ValueError, match="no such mesh"):
        run_benchmark("broken_one", out=known / "out")


def test_what_decides() -> None:
    late = Check("step", 0.5, 0.8, 0, "s", "aim", "at most", timing=True)
    assert verdict({"one": [late]}, alone=False)[0] is False
    assert verdict({"one": [late]}, alone=True)[0] is True
    assert verdict({"one": [Check("speed", 3.0, 3.0)]}, alone=True) == (False, ["checks that failed: 0 of 1"])


def test_a_ratio_over_nothing_fails() -> None:
    """As where a column of energies is lost: the row fails, and the benchmark goes on."""
    assert ratio(1.0, 4.0) == 0.25
    assert not Check("lost", 4.0, ratio(0.0, 0.0), relation="at least").passed


def test_new_files_of_both_folders_are_found_by_name() -> None:
    found = benchmarks(OTHERS)
    for folder in (CORE, OTHERS):
        names = {path.stem for path in folder.glob("*.py") if not path.stem.startswith("_")}
        assert {name for name, path in found.items() if path.parent == folder} == names
    assert {"waves", "growth", "stress_barrier", "speed"} < {path.stem for path in CORE.glob("*.py")}


def test_cases_beside_benchmarks_are_complete() -> None:
    files = sorted(OTHERS.glob("*.toml"))
    assert files and all(path.with_suffix(".py").is_file() for path in files)
    for path in files:
        assert isinstance(read_case(path), Case)


def test_the_core_set_imports_nothing_of_the_others() -> None:
    """It runs from a wheel, which has no tests."""
    others = re.compile(r"^ *(from|import) benchmarks", re.MULTILINE)
    assert [path.name for path in CORE.glob("*.py") if others.search(path.read_text())] == []


def test_without_a_checkout_a_message_says_where_the_others_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ruptfx.app.bench, "checkout_folder", lambda: None)
    with pytest.raises(RuptfxError) as raised:
        run_benchmark("bp1", out=tmp_path)
    assert says("--from tests/benchmarks", str(raised.value))
    assert run_benchmark("list", out=tmp_path) and "bp1" not in capsys.readouterr().out
    assert run_benchmark("list", out=tmp_path, folder=OTHERS) and "bp1" in capsys.readouterr().out
    with pytest.raises(RuptfxError) as raised:
        run_benchmark("list", folder=tmp_path)
    assert says(f"--from {tmp_path}", str(raised.value))
    with pytest.raises(RuptfxError) as raised:
        run_benchmark("bp11", out=tmp_path, folder=OTHERS)
    assert "'bp1'" in str(raised.value) and "--from" not in str(raised.value)


def test_a_name_is_in_one_folder_only(tmp_path: Path) -> None:
    (tmp_path / "waves.py").write_text("")
    with pytest.raises(RuptfxError) as raised:
        benchmarks(tmp_path)
    assert says("bench waves", str(raised.value))


def test_a_checkout_is_known_by_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some packages install a folder `tests` beside others."""
    monkeypatch.setattr(ruptfx.app.bench, "CORE", tmp_path / "ruptfx" / "app" / "bench")
    (tmp_path / "tests" / "benchmarks").mkdir(parents=True)
    assert checkout_folder() is None
    (tmp_path / "pyproject.toml").touch()
    assert checkout_folder() == tmp_path / "tests" / "benchmarks"
