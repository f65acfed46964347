"""Demos that are scripts."""

import ast
import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import synthetic

import ruptfx
from ruptfx import RuptfxError, read_case
from ruptfx.results import plots
from ruptfx.results.analysis import summarise
from ruptfx.results.record import Record

DEMOS = Path(__file__).parents[2] / "demos"
TIME, POSITION = synthetic.times(), synthetic.points()


@pytest.mark.parametrize(
    ("field", "said"),
    [
        # 3.9 and 0.1 m/s at every other point: the mesh's.
        (synthetic.grid_noise(TIME, POSITION, 1.9), "no speed, the slip rate varies from point to point"),
        (np.zeros((len(TIME), len(POSITION))), "no speed, it did not run"),
        # 2100 / 1255 = 1.67.
        (synthetic.crack(TIME, POSITION), "2100 m/s, 1.67 c_s"),
    ],
)
def test_shear_impact_tells_a_speed_only_where_there_is_one(field, said, tmp_path, monkeypatch, capsys):
    path = synthetic.write_run(tmp_path / "run", field, TIME, POSITION)
    with Record(path) as record:
        found = summarise(record)
        monkeypatch.setattr(Record, "summary", found)
        monkeypatch.setattr(ruptfx, "simulate", lambda case, out, overwrite: record, raising=False)
        monkeypatch.chdir(tmp_path)
        runpy.run_path(str(DEMOS / "shear_impact.py"))
    assert f"leading tip:  {said}" in capsys.readouterr().out


@pytest.mark.parametrize("path", sorted(DEMOS.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_speaks_with_one_voice_before_it_computes_or_prints(path):
    """`begin` silences other ranks; what runs or prints before it would appear once for each rank."""
    called = [
        each.func.id for each in sorted(
            (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)),
            key=lambda node: node.lineno,
        ) if isinstance(each.func, ast.Name)
    ]  # fmt: skip
    loud = [number for number, name in enumerate(called) if name in ("print", "save", "save_numbers", "main")]
    assert "begin" in called and called.index("begin") < min(loud, default=len(called))


@pytest.mark.parametrize("path", sorted(DEMOS.glob("*.py")), ids=lambda path: path.stem)
def test_ranks_of_a_script_do_not_write_one_picture_at_the_same_time(path):
    """`ruptfx.app.script.save` writes on the first rank and says where; that of `figure_style` writes on all."""
    imported = {
        (node.module, name.name) for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) for name in node.names
    }  # fmt: skip
    assert ("ruptfx.results.figure_style", "save") not in imported
    assert ("ruptfx.app.script", "save") in imported or ".savefig(" not in path.read_text(encoding="utf-8")


WRONG = {
    "impact_3d": [["abc"], ["-2e-3"], ["nan"], ["2 s"], ["2e-3", "abc"]],
    "rough_rupture": [["abc"], ["small", "abc"]],
    "four_modes_descent": [[], ["abc"], [str(DEMOS / "reconstruct.csv")], [str(DEMOS / "reconstruct.csv"), "-1"],
                           [str(DEMOS / "reconstruct.csv"), "60", "V"]],
}  # fmt: skip
"""Arguments of scripts that have some; others have none."""


@pytest.mark.parametrize(
    ("script", "words"),
    [(path, words) for path in sorted(DEMOS.glob("*.py")) for words in WRONG.get(path.stem, [["abc"]])],
    ids=lambda value: value.stem if isinstance(value, Path) else " ".join(map(str, value)).replace(str(DEMOS), ""),
)
def test_a_script_refuses_arguments_that_it_does_not_have(script, words, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(script), *words])
    monkeypatch.setattr(sys.modules["__main__"], "__file__", str(script), raising=False)
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(ruptfx, "simulate", lambda *_, **__: pytest.fail("it runs"), raising=False)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RuptfxError, match=words[-1] if words and words[-1][0] != "/" else "scores"):
        runpy.run_path(str(script))
    assert not list(tmp_path.iterdir())


def test_the_error_of_an_argument_is_one_line(tmp_path):
    command = [sys.executable, str(DEMOS / "impact_3d.py"), "abc"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 1 and not result.stdout
    assert result.stderr == (
        "error: element size 'abc': input should be a valid number, or one with a unit, such as '2 m'\n"
    )


def test_the_container_and_make_demo_draw_the_pictures_of_the_main_script(tmp_path, monkeypatch):
    """All three run the same case; the script is run on two ranks by its reader."""
    cases = []

    def stand_in(case, out, overwrite):
        cases.append(case)
        raise RuptfxError("no run is needed")

    monkeypatch.setattr(ruptfx, "simulate", stand_in, raising=False)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RuptfxError, match="no run is needed"):
        runpy.run_path(str(DEMOS / "shear_impact.py"))
    root = DEMOS.parent
    image = json.loads(re.search(r"(?m)^CMD (.*)$", (root / "Dockerfile").read_text())[1])
    make = re.search(r"ruptfx (run demos/\S+ --ranks 2)", (root / "Makefile").read_text())[1].split()
    assert image[1:5] == make and "--set" not in image
    assert cases[0].table() == read_case(root / image[2]).table()


@pytest.mark.slow
@pytest.mark.fem
def test_stress_barrier_follows_the_equation_of_motion_and_stops(tmp_path, monkeypatch):
    """The script itself, on elements twice as large, and shorter. Found: 0.03, 0.04 c_R, stops 0.4 mm away."""
    pytest.importorskip("dolfinx")
    from ruptfx.app.bench import stress_barrier

    read, coarse = stress_barrier.read_case, ["mesh.element_size=2e-3", "mesh.growth=1.3", "duration=65e-6"]
    monkeypatch.setattr(stress_barrier, "read_case", lambda path, overrides: read(path, [*overrides, *coarse]))
    monkeypatch.setattr(plots, "save_all", lambda record, **_: (record.path / "figures").mkdir() or [])
    monkeypatch.chdir(tmp_path)
    names = runpy.run_path(str(DEMOS / "stress_barrier.py"))
    assert (tmp_path / "runs" / "stress_barrier" / "figures" / "front.png").exists()
    for shape, end in (("one tip", 38e-3), ("bilateral", 30e-3)):
        theory, front = names["found"][shape]
        there = (front.place > 12.5e-3) & (front.place < end) & (abs(front.place - 30e-3) > 3e-3)
        expected = np.interp(front.place, theory.length, theory.speed)
        np.testing.assert_allclose(front.speed[there], expected[there], rtol=0, atol=0.06 * names["c_R"])
    theory, front = names["found"]["one tip"]
    assert front.stopped == pytest.approx(theory.arrest, abs=1.5e-3)
    assert names["found"]["bilateral"][1].stopped > 45e-3


@pytest.mark.fem
@pytest.mark.slow
def test_reconstruct_makes_its_data_and_gets_the_interface_back(tmp_path, monkeypatch):
    """The script itself: its run makes the numbers of the CSV file, and most known slip rates are in the bands."""
    pytest.importorskip("dolfinx")
    monkeypatch.chdir(tmp_path)
    names = runpy.run_path(str(DEMOS / "reconstruct.py"))
    wanted = np.loadtxt(DEMOS / "reconstruct.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(
        np.loadtxt(names["OUT"] / "reconstruct.csv", delimiter=",", skiprows=1), wanted, atol=0.05
    )
    assert 0.6 < names["within"] < 0.95 and names["off"] < 0.15
    assert names["made"].law.interval("mu_s")[1] > 0.6 and names["made"].law.interval("D_c")[1] < 5e-6
    assert (names["OUT"] / "reconstruct.png").exists()
