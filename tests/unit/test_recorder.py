"""When records are made, and that none is lost or added."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from small_cases import case

from ruptfx import simulate

pytestmark = pytest.mark.fem


def test_records_from_the_first_time_to_the_last(tmp_path):
    """5 us: rows of the interface every 0.5 us with the start, snapshots of the bodies every 1 us without it."""
    parsed = case({"duration": 5e-6, "output.interface_interval": 0.5e-6, "output.bulk_interval": 1e-6})
    with simulate(parsed, tmp_path / "run", progress=False) as record:
        step = record.summary["time_step"]
        assert float(record.interface.time[0]) == 0
        for time, expected, late in (
            (record.interface.time, 0.5e-6 * np.arange(11), 1.0),
            (record.energy.time, 0.5e-6 * np.arange(11), 1.5),
            (record.bulk.time, 1e-6 * np.arange(1, 6), 1.5),
        ):
            assert len(time) == len(expected)
            # Made by the first step whose tractions reach the time; energies and bodies are half a step later.
            np.testing.assert_allclose(time, expected, rtol=0, atol=late * step)
        np.testing.assert_allclose((record.energy.time - record.interface.time.values)[1:] / step, 0.5, rtol=1e-6)
