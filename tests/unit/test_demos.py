"""Demos that are scripts."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import synthetic

import ruptfx
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
