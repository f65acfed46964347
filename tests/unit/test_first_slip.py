"""What counts as sliding where bodies slide far, and as the origin of a rupture; labels that move apart."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers import synthetic

from ruptfx.results import plots
from ruptfx.results.analysis import rupture_origin, sliding_rate
from ruptfx.results.plots.front import spread
from ruptfx.results.record import Record

TIME, POSITION = synthetic.times(121), synthetic.points(40)


def started(path: Path, time: float, center: float) -> Path:
    """Say in a run where and when its case starts a rupture."""
    with h5py.File(path / "interface.h5", "a") as file:
        file.attrs["nucleation_time"], file.attrs["nucleation_position"] = time, center
    return path


def test_where_nothing_touches_nothing_slides(tmp_path: Path) -> None:
    crack = synthetic.crack(TIME, POSITION)
    with Record(synthetic.write_run(tmp_path / "run", crack, TIME, POSITION, slides=True)) as record:
        away = np.isin(record.interface["contact"].values, (0, 3))
        assert away.any() and not sliding_rate(record)[away].any()
        np.testing.assert_array_equal(sliding_rate(record)[~away], crack[~away])


def test_a_rupture_begins_where_the_case_starts_it(tmp_path: Path) -> None:
    """Records in which the interface was loaded have no rupture times; pictures of the rupture leave them out."""
    rate = synthetic.crack(TIME, POSITION, start=20e-6)
    with Record(started(synthetic.write_run(tmp_path / "run", rate, TIME, POSITION), 20e-6, 0.03)) as record:
        assert rupture_origin(record) == (0.03, 20e-6)
        assert plots.space_time(record).figure.axes[0].get_ylim()[0] > 0


@pytest.mark.parametrize("name", ["front", "space_time"])
def test_a_run_without_sliding_has_no_such_figure(name: str, tmp_path: Path) -> None:
    with Record(synthetic.write_run(tmp_path / "run", np.zeros((121, len(POSITION))), TIME, POSITION)) as record:
        assert not plots.suits(name, record)


def test_labels_move_apart_as_little_as_they_need() -> None:
    # 0.50 and 0.52 share their mean 0.51; 0.9 stays.
    np.testing.assert_allclose(spread(np.array([0.52, 0.9, 0.50]), 0.1), [0.56, 0.9, 0.46])
    np.testing.assert_array_equal(spread(np.array([0.1, 0.3]), 0.1), [0.1, 0.3])
    assert spread(np.array([]), 0.1).size == 0
