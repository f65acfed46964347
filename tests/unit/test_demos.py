"""Demos that are scripts."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import synthetic

import ruptfx
from ruptfx import plots
from ruptfx.analysis import summarise
from ruptfx.record import Record

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
        monkeypatch.setattr(ruptfx, "simulate", lambda case, out: record, raising=False)
        runpy.run_path(str(DEMOS / "shear_impact.py"))
    assert f"leading tip:  {said}" in capsys.readouterr().out


@pytest.mark.fem
def test_stress_barrier_follows_the_equation_of_motion_and_slows_down(tmp_path, monkeypatch):
    """The script itself, on elements twice as large and half as long: 4 % before the barrier, 8 % in it."""
    pytest.importorskip("dolfinx")
    read = ruptfx.read_case
    coarse = ["mesh.element_size=2e-3", "mesh.growth=1.3", "duration=60e-6"]
    monkeypatch.setattr(ruptfx, "read_case", lambda path: read(path, coarse), raising=False)
    monkeypatch.setattr(plots, "save_all", lambda record, **_: (record.path / "figures").mkdir())
    monkeypatch.chdir(tmp_path)
    names = runpy.run_path(str(DEMOS / "stress_barrier.py"))
    assert (tmp_path / "runs" / "stress_barrier" / "figures" / "front.png").exists()
    places, speed, predicted = names["places"], np.array(names["speed"]), names["predicted"]
    ratio = speed / np.interp(places, predicted.length, predicted.speed)
    np.testing.assert_allclose(ratio[(places > 11.5e-3) & (places < 27.5e-3)], 1, atol=0.04)
    np.testing.assert_allclose(ratio[(places > 33.5e-3) & (places < 38.5e-3)], 1, atol=0.08)
    assert speed[places < 42.5e-3][-1] < 0.6 * names["medium"].c_R
    assert 30e-3 < predicted.arrest < 50e-3
