"""The scalars of a run, from its files."""

import json

import numpy as np
import pytest
from helpers import synthetic

from ruptfx.results.analysis import UNITS, UNITS_OF_FRACTURE, UNITS_OF_SURFACES, rupture_origin, summarise
from ruptfx.results.record import Record
from ruptfx.results.summary_fields import UNITS_OF_EVENTS

TIME, POSITION = synthetic.times(), synthetic.points()


def summary_of(path, field, **options):
    with Record(synthetic.write_run(path / "run", np.maximum(field, 0), TIME, POSITION, **options)) as record:
        return summarise(record)


def test_summary_of_a_train(tmp_path):
    found = summary_of(tmp_path, synthetic.train(TIME, POSITION))
    assert (found["mode"], found["mode_at_half_threshold"], found["speed_regime"]) == ("train", "train", "supershear")
    assert found["tip_speed"] == pytest.approx(2100, rel=1e-3)
    # 2100 / 1255 and 2100 / 2200.
    assert found["tip_speed_over_c_s"] == pytest.approx(1.6733, rel=1e-3)
    assert found["tip_speed_over_c_l"] == pytest.approx(0.9545, rel=1e-3)
    assert found["peak_slip_rate"] == pytest.approx(2, rel=1e-2)
    # The first front passes the left end at 5 us, the next saved time is 5.2 us.
    assert found["first_sliding"] == pytest.approx(5.2e-6)
    # A parabola of height 2 m/s lasts 6 mm / 2100 m/s: slip (2/3) x 2 x 2.857 us = 3.81 um, six times.
    assert found["max_slip"] == pytest.approx(6 * 3.81e-6, rel=0.01)
    assert found["energy_closure"] == pytest.approx(2e-4)
    assert found["trailing_fronts"] == 5 and found["trailing_fronts_faster_than_c_l"] == 0


def test_summary_in_antiplane_knows_only_the_shear_wave(tmp_path):
    found = summary_of(tmp_path, synthetic.train(TIME, POSITION), plane="antiplane")
    assert found["tip_speed_over_c_s"] is not None
    assert found["tip_speed_over_c_l"] is None and found["tip_speed_over_c_R"] is None


def test_summary_survives_json(tmp_path):
    found = summary_of(tmp_path, np.zeros((len(TIME), len(POSITION))))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["mode"] == "none" and found["tip_speed"] is None and found["max_slip"] == 0
    of_lines = UNITS.keys() - UNITS_OF_FRACTURE.keys() - UNITS_OF_SURFACES.keys() - UNITS_OF_EVENTS.keys()
    assert of_lines <= found.keys() and found["first_sliding"] is None


@pytest.mark.parametrize(("speed", "late"), [(0.0, 0.0), (0.1, 1.0)])
def test_origin_of_a_spontaneous_rupture(tmp_path, speed, late):
    # Without a driven edge, or with one so slow that sliding starts 1 s later, the rupture starts where sliding
    # began: at 30 mm, after 5 us.
    field = synthetic.crack(TIME, np.abs(POSITION - 0.03))
    with Record(synthetic.write_run(tmp_path / "run", field, TIME + late, POSITION, V_imp=speed)) as record:
        position, time = rupture_origin(record)
        assert position == pytest.approx(0.03, abs=1e-3)
        assert time == pytest.approx(late + 5e-6, abs=2 * np.diff(TIME)[0])
        assert summarise(record)["mode"] == "crack"


def test_origin_of_an_impact(tmp_path):
    # The first front passes the left end after 5 us, less than the 80 us a shear wave takes: the drive is the cause.
    with Record(synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)) as record:
        assert rupture_origin(record) == (0.0, 0.0)
