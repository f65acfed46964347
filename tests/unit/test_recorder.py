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


def test_a_run_is_complete_before_it_draws(tmp_path, monkeypatch):
    """What fails while figures are drawn takes nothing away: the summary is there, and was told."""
    from ruptfx import RuptfxError, plots

    seen = []
    monkeypatch.setattr(plots, "FIGURES", {"front": lambda record: seen.append("drawn") or 1 / 0})
    out, told = tmp_path / "run", []
    parsed = case({"duration": 1e-6, "output.figures": True})
    with pytest.raises(RuptfxError, match="division by zero"):
        simulate(parsed, out, progress=False, complete=lambda: told.append((out / "summary.json").is_file()))
    assert (seen, told) == (["drawn"], [True])


def test_time_by_phase_is_all_there_is():
    """Phases inside of others interrupt them; together they are the processor time of the process."""
    import time

    from ruptfx import stopwatch

    def work() -> None:
        until = time.thread_time() + 0.02
        while time.thread_time() < until:
            pass

    before = stopwatch.phases()
    with stopwatch.phase("outer"):
        work()
        with stopwatch.phase("inner"):
            work()
            work()
    after = stopwatch.phases()
    assert 0.02 <= after["outer"] < 0.03 and 0.04 <= after["inner"] < 0.05
    assert sum(after.values()) == pytest.approx(time.process_time(), abs=0.01)
    assert {name for name in after if after[name] - before.get(name, 0.0) > 0.015} == {"outer", "inner"}
