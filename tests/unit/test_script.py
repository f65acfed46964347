"""Scripts under `mpirun`: one rank prints and draws; a script of a lumped model ends on the others."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from ruptfx.app.script import begin, read_number, read_words, save, save_numbers


@pytest.fixture
def other_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(sys, "stdout", sys.stdout)
    monkeypatch.setattr(sys, "argv", ["script.py"])


@pytest.mark.usefixtures("other_rank")
def test_other_ranks_neither_print_nor_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begin(tmp_path / "run")
    print("once")
    save(Figure(), tmp_path / "picture.png")
    save_numbers(tmp_path / "run", {"speed": (2.0, "m/s")})
    sys.stdout.close()
    assert not capsys.readouterr().out and not list(tmp_path.iterdir())


@pytest.mark.usefixtures("other_rank")
def test_a_script_for_one_rank_ends_on_others(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as end:
        begin(tmp_path / "run", ranks=False)
    assert end.value.code == 0


def test_the_first_rank_makes_the_folder_and_names_the_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMPI_COMM_WORLD_RANK", raising=False)
    path = tmp_path / "new" / "picture.png"
    save(Figure(), path)
    assert path.read_bytes()[1:4] == b"PNG" and str(path) in capsys.readouterr().out


def test_numbers_are_saved_and_printed_with_their_units(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMPI_COMM_WORLD_RANK", raising=False)
    slip = np.float64(2e-6), "m"
    save_numbers(
        tmp_path, {"mode": "crack", "ratio": np.float64(0.25), "slip": slip, "Q": (19, "1/s"), "c": (1792.3, "m/s")}
    )
    saved = json.loads((tmp_path / "numbers.json").read_text())
    assert saved == {"mode": "crack", "ratio": 0.25, "slip": [2e-6, "m"], "Q": [19.0, "1/s"], "c": [1792.3, "m/s"]}
    assert capsys.readouterr().out.splitlines() == [
        "mode: crack",
        "ratio: 0.25",
        "slip: 2 um",
        "Q: 19 1/s",
        "c: 1792 m/s",
    ]


@pytest.mark.parametrize(("program", "words"), [("demo.py", ["-f", "kernel.json"]), ("ipykernel_launcher.py", [])])
def test_words_of_a_notebook_are_not_those_of_its_script(
    program: str, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first cell of a demo as a notebook says that the file is the script."""
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(sys.modules["__main__"], "__file__", "demo.py", raising=False)
    monkeypatch.setattr(sys, "argv", [program, "-f", "kernel.json"])
    assert read_words() == words


def test_a_number_may_have_a_unit() -> None:
    assert [read_number(text, "size", "m") for text in ("2e-3", "2 mm", "2mm")] == [2e-3] * 3
