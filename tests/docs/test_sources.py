"""Rows of the page from a paper to a command: their commands, pictures and numbers exist."""

from __future__ import annotations

import fnmatch
import itertools
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app import bench
from ruptfx.app.bench import benchmarks
from ruptfx.app.cli import app
from ruptfx.app.reference.sources import Row, files_of, rows_of, sources

CHECKOUT = Path(__file__).parents[2]
DOCS = CHECKOUT / "docs"
AGREES = ("yes", "in part", "no", "not done")
ROWS = [pytest.param(row, id=f"{name}-{number}") for name, rows in sources().items() for number, row in enumerate(rows)]


@pytest.mark.parametrize("row", ROWS)
def test_a_row_has_a_command_that_exists_or_says_what_is_missing(row: Row) -> None:
    commands = {command.name or command.callback.__name__.replace("_", "-") for command in app.registered_commands}
    words = shlex.split(row.command)
    for word in (word for word in words if word.startswith("demos/")):
        assert (CHECKOUT / word).is_file()
    assert not words or words[0] in ("python", "pytest") or words[1] in commands
    if words[1:2] == ["bench"]:
        assert words[2] in benchmarks()
    assert row.agrees.startswith(AGREES) and row.printed
    assert row.agrees.startswith("yes") or re.search(r"\w: .", row.agrees), "give the reason"
    assert row.computed or row.agrees.startswith("not done")
    assert not row.picture or (DOCS / row.picture).is_file()


def saved_numbers() -> dict[str, dict[str, float | str]]:
    """Numbers by script, case or benchmark and by name, in SI units or those that they are saved in."""
    runs = json.loads((DOCS / "pictures" / "numbers.json").read_text(encoding="utf-8"))
    numbers = {
        name: {key: value[0] if isinstance(value, list) else value for key, value in each.items()}
        for key_, each in runs.items() for name in (key_, f"{key_}.toml")
    }  # fmt: skip
    for path in (DOCS / "verification" / "results").glob("*.json"):
        checks = json.loads(path.read_text(encoding="utf-8")).get("checks", [])
        numbers[path.stem] = {check["quantity"]: check["found"] for check in checks}
    return numbers


def value_of(text: str, numbers: dict[str, dict[str, float | str]]) -> float | str:
    """A number, or the saved one that `[[NAME|NUMBER]]` stands for."""
    match = re.fullmatch(r"\[\[(.+?)\|(.+?)\]\]", text)
    if not match:
        return float(text)
    (name,) = fnmatch.filter(numbers[match[1]], match[2])
    return numbers[match[1]][name]


def holds(condition: str, numbers: dict[str, dict[str, float | str]]) -> bool:
    """Whether a condition of sources.toml is true: A < B < C, A is WORD, or A is within N % of B."""
    if match := re.fullmatch(r"(\S.*\]\]) is within (\S+) % of (.+)", condition):
        found, wanted = (float(value_of(match[place], numbers)) for place in (1, 3))
        return abs(found - wanted) <= 0.01 * float(match[2]) * abs(wanted)
    if match := re.fullmatch(r"(\[\[.+\]\]) is (.+)", condition):
        return value_of(match[1], numbers) == match[2]
    values = [float(value_of(each, numbers)) for each in condition.split(" < ")]
    return len(values) > 1 and all(low < high for low, high in itertools.pairwise(values))


@pytest.mark.parametrize("row", ROWS)
def test_a_number_of_a_row_is_saved_by_a_run(row: Row) -> None:
    """Text has no digits of its own: numbers are names of saved ones, or inputs and formulas in backticks."""
    numbers = saved_numbers()
    for number in re.findall(r"\[\[.+?\]\]", row.computed):
        assert value_of(number, numbers) is not None
    text = re.sub(r"\[\[.+?\]\]|`.+?`|\b[A-Za-z_]+\d+\b|[23]D\b", "", row.computed)
    assert not re.search(r"\d", text), f"{text}: save the number by `save_numbers` or a benchmark, and name it here"


@pytest.mark.parametrize("row", ROWS)
def test_the_verdict_of_a_row_holds_for_the_saved_numbers(row: Row) -> None:
    """Numbers of scripts and cases, and failed checks beside a yes, are in conditions, which hold."""
    conditions = "; ".join(row.holds)
    broken = [condition for condition in row.holds if not holds(condition, saved_numbers())]
    assert not broken, f"{row.what}: '{row.agrees}' is to be changed, for these no longer hold: {broken}"
    named = re.findall(r"\[\[(.+?)\|(.+?)\]\]", row.computed)
    assert row.holds or not [name for name, _ in named if name.endswith((".py", ".toml"))]
    for name, wanted in named if row.agrees.startswith("yes") else []:
        if not name.endswith((".py", ".toml")):
            saved = json.loads((DOCS / "verification" / "results" / f"{name}.json").read_text(encoding="utf-8"))
            failed = [check["quantity"] for check in saved["checks"] if not check["passed"]]
            assert not fnmatch.filter(failed, wanted) or f"[[{name}|{wanted}]]" in conditions, wanted


def test_conditions_are_false_for_other_numbers() -> None:
    numbers = {"a.py": {"speed": 2.0, "mode": "crack", "slip": 1.99}}
    assert holds("1 < [[a.py|slip]] < [[a.py|speed]]", numbers) and not holds("[[a.py|speed]] < [[a.py|slip]]", numbers)
    assert holds("[[a.py|mode]] is crack", numbers) and not holds("[[a.py|mode]] is pulse", numbers)
    assert holds("[[a.py|slip]] is within 1 % of [[a.py|speed]]", numbers)
    assert not holds("[[a.py|slip]] is within 0.1 % of 2", numbers)


def test_the_page_has_a_table_of_every_document() -> None:
    page = (DOCS / "gallery" / "sources.md").read_text(encoding="utf-8")
    assert re.findall(r"\{ruptfx-sources\} (\w+)", page) == list(sources())
    for path in (CHECKOUT / "README.md", DOCS / "index.md", DOCS / "gallery" / "index.md"):
        assert re.search(r"\]\((docs/|gallery/)?(gallery/)?sources\.md\)", path.read_text(encoding="utf-8")), path


def test_benchmarks_that_a_wheel_lacks_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the second document that is `lumped`, which is in tests/benchmarks; a checkout has it."""
    monkeypatch.setenv("COLUMNS", "400")
    run, word = CliRunner().invoke, "--from tests/benchmarks"
    assert word not in run(app, ["demos", str(tmp_path / "here"), "--source", "001"]).output
    monkeypatch.setattr(bench, "checkout_folder", lambda: None)
    (line,) = [
        line
        for line in run(app, ["demos", str(tmp_path / "wheel"), "--source", "001"]).output.splitlines()
        if word in line
    ]
    assert line.startswith("bench lumped:")


def test_pictures_of_a_study_that_was_not_run_are_refused(tmp_path: Path) -> None:
    """The command that the message names is that of the row, with the copy of the study that lies beside the script."""
    script = CHECKOUT / "demos" / "granite_figures.py"
    result = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 1 and "Traceback" not in result.stderr
    (row,) = {row.command for row in sources()["block_in_shear"] if script.name in row.command}
    study = row.partition(" && ")[0].replace("demos/", f"{script.parent}/")
    assert study in " ".join(result.stderr.split())
    assert not list(tmp_path.iterdir())  # the study can be written there


def test_demos_of_a_document_are_found_with_all_files_they_need() -> None:
    """The chain and the sequence of slips with their cases, and what the mode map of the lecture runs; no granite."""
    second = {path.name for path in files_of("001", CHECKOUT / "demos")}
    assert {"spring_block.toml", "slip_sequence.py", "slip_sequence.toml"} <= second
    assert second == {path.name for path in files_of("slip_sequences", CHECKOUT / "demos")}
    first = {path.name for path in files_of("000", CHECKOUT / "demos")}
    assert {"mode_map.toml", "impact.toml", "lecture_cases.py", "fibre_pull_out.toml", "tilted_block.toml"} <= first
    assert not any("granite" in name for name in first | second)
    with pytest.raises(RuptfxError, match=r"000 or lecture,\s001"):
        rows_of("005")
