"""Figures that a process draws which waited for the run: the same pictures, the same errors, and nothing lost."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import psutil
import pytest
from helpers import synthetic

from ruptfx import RuptfxError
from ruptfx.platform.progress import working
from ruptfx.results import figure_process, plots
from ruptfx.results.plots import _panels
from ruptfx.results.record import Files


@pytest.fixture
def run(tmp_path: Path) -> Path:
    time, position = synthetic.times(61), synthetic.points(40)
    return synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)


@pytest.fixture
def few(run: Path) -> Path:
    """A run with histories of the interface alone, which has four figures."""
    for name in ("bulk.h5", "instruments.h5", "energy.csv"):
        (run / name).unlink()
    return run


def waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a run does that has not imported what draws, with a core to spare."""
    with monkeypatch.context() as patched:
        patched.setattr(figure_process, "cores", lambda: 2)
        patched.delitem(sys.modules, "ruptfx.results.plots", raising=False)
        figure_process.prepare()
    assert figure_process._waiting is not None


@pytest.mark.slow
def test_pictures_are_the_same(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waiting(monkeypatch)
    process = figure_process._waiting
    monkeypatch.setattr(plots, "save_all", None)  # nothing is drawn here
    figure_process.announce(run)
    figure_process.draw(run)
    assert process is not None and process.returncode == 0
    monkeypatch.undo()
    with Files(run) as record:
        expected = plots.save_all(record, tmp_path / "expected")
    assert {path.name for path in expected} == {path.name for path in (run / "figures").iterdir()} and expected
    for path in expected:
        assert path.read_bytes() == (run / "figures" / path.name).read_bytes()


def test_pixels_are_set_up_while_the_run_goes_on(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with h5py.File(run / "bulk.h5", "w") as file:  # no snapshot yet
        file["points"], file["cells"] = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), [[0, 1, 2, 3]]
        file["time"] = np.zeros(0)
    made = []
    monkeypatch.setattr(_panels, "_last", [])
    monkeypatch.setattr(_panels, "Raster", lambda *mesh: made.append(mesh))
    for _ in range(2):  # asked again when the run is complete
        with Files(run) as record:
            plots.set_up(record)
    assert len(made) == 1


def test_errors_come_back(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (run / "figures").write_text("in the way")
    waiting(monkeypatch)
    with pytest.raises(RuptfxError, match=re.escape(f"{run / 'figures'}: ")):
        figure_process.draw(run)


@pytest.mark.usefixtures("blank_pictures")
def test_without_the_process_figures_are_drawn_all_the_same(few: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waiting(monkeypatch)
    assert figure_process._waiting is not None
    figure_process._waiting.kill()
    figure_process._waiting.wait()
    figure_process.announce(few)
    figure_process.draw(few)
    assert len(list((few / "figures").iterdir())) == 4


def test_ctrl_c_leaves_no_process(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process forks into several, which a signal to it alone does not end."""
    waiting(monkeypatch)
    process = figure_process._waiting
    assert process is not None and process.stdin is not None
    group: list[psutil.Process] = []
    usual = process.communicate

    def interrupted(request: str | None = None) -> tuple[str, str]:
        if request is None:
            return usual()
        process.stdin.write(request)
        process.stdin.flush()
        for _ in range(600):
            group[:] = psutil.Process(process.pid).children()
            if len(group) == 2:
                raise KeyboardInterrupt
            time.sleep(0.05)
        return "", ""

    monkeypatch.setattr(process, "communicate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        figure_process.draw(run)
    for _ in range(200):
        if not any(map(is_alive, group)):
            break
        time.sleep(0.05)
    assert not any(map(is_alive, group))


def is_alive(process: psutil.Process) -> bool:
    """Whether it runs; one that is dead may wait for an init that collects it."""
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_its_start_is_timed() -> None:
    """It imports what draws: a tenth of a second would be Python alone."""
    assert 0.2 < figure_process.start_up()() < 60


def test_nobody_waits_where_it_would_not_pay(monkeypatch: pytest.MonkeyPatch) -> None:
    figure_process.prepare()  # what draws is imported
    assert figure_process._waiting is None
    monkeypatch.delitem(sys.modules, "ruptfx.results.plots", raising=False)
    monkeypatch.setattr(figure_process, "cores", lambda: 1)
    figure_process.prepare()
    assert figure_process._waiting is None
    figure_process.dismiss()
    waiting(monkeypatch)
    process = figure_process._waiting
    figure_process.dismiss()
    assert figure_process._waiting is None and process is not None and process.returncode


@pytest.mark.usefixtures("blank_pictures")  # those that are drawn here, without another process
@pytest.mark.parametrize("alone", [pytest.param(False, marks=pytest.mark.slow), True])
def test_figures_are_named_where_phases_are_lines(
    alone: bool, few: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """One line for each when it is written; on a terminal a spinner shows that something is done."""
    for shown in ("lines", "spinner", "nothing") if alone else ("lines", "spinner"):
        if not alone:
            waiting(monkeypatch)
        monkeypatch.setenv("RUPTFX_TERMINAL", "1" if shown == "spinner" else "")
        with working("drawing the figures", shown != "nothing"):
            figure_process.draw(few)
        named = re.findall(r"^  (\w+\.png)$", capfd.readouterr().err, re.M)
        drawn = sorted(path.name for path in (few / "figures").iterdir())
        assert sorted(named) == (drawn if shown == "lines" else []) and len(drawn) == 4
