"""Scripts under `mpirun`: one rank prints and draws; a script of a lumped model ends on the others."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from ruptfx.app.script import begin, save


@pytest.fixture
def other_rank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(sys, "stdout", sys.stdout)


@pytest.mark.usefixtures("other_rank")
def test_other_ranks_neither_print_nor_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begin(tmp_path / "run")
    print("once")
    save(Figure(), tmp_path / "picture.png")
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
