"""When records are made, and that none is lost or added."""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.small_cases import case

from ruptfx import simulate
from ruptfx.input.fields import FIELDS
from ruptfx.platform import parallel
from ruptfx.results import plots
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields
from ruptfx.run.recording.interface_file import InterfaceFile
from ruptfx.run.recording.mechanisms import records_of
from ruptfx.run.recording.mechanisms.faults import FaultRecords
from ruptfx.run.recording.shared_file import SharedFile
from ruptfx.run.recording.table_file import TableFile
from ruptfx.run.recording.writer import Writer

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


@pytest.mark.parametrize(
    ("speeds", "end"),
    [({"upper.left": 2.0}, 0.0), ({"upper.left": 2.0, "lower.right": 0.0}, 0.0), ({"lower.right": 2.0}, 12e-3),
     ({"upper.left": 0.5, "upper.right": 2.0}, 12e-3), ({"upper.top": 2.0}, 0.0), ({"lower.right": 0.0}, 0.0)],
)  # fmt: skip
def test_the_loaded_end_is_next_to_the_edge_that_is_driven_fastest(speeds, end, tmp_path):
    """An edge that is held loads no end: the interface goes from 0 to 12 mm."""
    edges = [{"kind": "driven", "edge": edge, "component": "x", "velocity": v} for edge, v in speeds.items()]
    with simulate(case({"duration": 1e-6, "boundaries": edges}), tmp_path / "run", progress=False) as record:
        assert record.interface.attrs["loaded_end"] == pytest.approx(end)


def test_the_log_is_that_of_the_run_while_it_lasts(tmp_path, caplog):
    """Its messages go to run.log alone; afterwards the logger of the process is as before."""
    log = logging.getLogger("ruptfx.run")
    before = log.handlers, log.level, log.propagate
    simulate(case({"duration": 1e-6}), tmp_path / "run", progress=False).close()
    assert "dt" in (tmp_path / "run" / "run.log").read_text() and not caplog.records
    assert (log.handlers, log.level, log.propagate) == before
    log.warning("after the run")
    assert caplog.messages == ["after the run"]
    assert "after the run" not in (tmp_path / "run" / "run.log").read_text()


def test_snapshots_hold_what_is_asked_for_in_the_space_that_is_asked_for(tmp_path):
    """The same numbers in half the space, and compressed in less; what is not asked for is neither there nor drawn."""
    keys = {"duration": 4e-6, "output.bulk_interval": 1e-6, "output.checkpoint_steps": 30}
    plain = case(keys)
    small = case({
        **keys, "output.bulk_fields": ["stress", "displacement"], "output.bulk_precision": "single",
        "output.bulk_compression": 4, "output.plate_thickness": 5e-3, "materials.default.fringe_constant": 22e3,
    })  # fmt: skip
    one = simulate(plain, tmp_path / "plain", progress=False)
    with one, simulate(small, tmp_path / "small", progress=False) as other:
        assert {"velocity", "fringe"} & set(other.bulk) == set()
        for name in ("stress", "displacement"):
            assert other.bulk[name].dtype == np.float32
            np.testing.assert_array_equal(other.bulk[name], one.bulk[name].values.astype(np.float32))
        assert plots.suits("snapshots", other) and plots.suits("wavefield", one)
        assert not plots.suits("wavefield", other) and not plots.suits("fringes", other)
    with h5py.File(tmp_path / "small" / "bulk.h5") as file:
        stress = file["stress"]
        assert (stress.compression, stress.compression_opts) == ("gzip", 4)
        assert stress.id.get_storage_size() < 0.6 * stress.size * 4
    assert 'Precision="4"' in (tmp_path / "small" / "bulk.xdmf").read_text()
    # A checkpoint has them as they are, and goes on.
    import shutil

    shutil.copytree(tmp_path / "small", tmp_path / "stopped")
    (tmp_path / "stopped" / "summary.json").unlink()
    again = simulate(small, tmp_path / "stopped", progress=False, resume=True)
    with again, h5py.File(tmp_path / "small" / "bulk.h5") as file:
        np.testing.assert_array_equal(again.bulk["stress"], file["stress"])


def test_a_run_is_complete_before_it_draws(tmp_path, monkeypatch):
    """What fails while figures are drawn takes nothing away: the summary is there, and was told."""
    from ruptfx import RuptfxError
    from ruptfx.results import plots

    seen = []
    monkeypatch.setattr(plots, "FIGURES", {"snapshots": lambda record: seen.append("drawn") or 1 / 0})
    out, told = tmp_path / "run", []
    parsed = case({"duration": 1e-6, "output.figures": True})
    with pytest.raises(RuptfxError, match="division by zero"):
        simulate(parsed, out, progress=False, complete=lambda: told.append((out / "summary.json").is_file()))
    assert (seen, told) == (["drawn"], [True])


def test_time_by_phase_is_all_there_is(monkeypatch):
    """Phases inside of others interrupt them; together they are all the time since the start."""
    from ruptfx.platform import stopwatch

    now = [100.0]
    monkeypatch.setattr(stopwatch.time, "perf_counter", lambda: now[0])

    def work(seconds: float) -> None:
        now[0] += seconds

    stopwatch.restart()
    work(0.5)
    with stopwatch.phase("outer"):
        work(1.0)
        with stopwatch.phase("inner"):
            work(2.0)
        work(4.0)
    work(8.0)
    with stopwatch.phase("inner"):
        work(16.0)
    assert stopwatch.phases() == {"start": 8.5, "outer": 5.0, "inner": 18.0}
    stopwatch.restart()
    assert stopwatch.phases() == {"start": 0.0}


def test_the_writer_does_all_in_order_and_nobody_waits_for_it() -> None:
    disk, done = threading.Event(), []
    writer = Writer()
    writer.submit(disk.wait)
    for number in range(20):
        writer.submit(lambda number=number: done.append(number))
    assert done == []  # the disk is slow, and here we are
    disk.set()
    writer.drain()
    assert done == list(range(20))
    writer.close()


def test_the_writer_stops_at_the_first_error() -> None:
    done, writer = [], Writer()
    for action in (lambda: done.append(1), lambda: 1 / 0, lambda: done.append(2)):
        writer.submit(action)
    writer.close()
    assert done == [1] and isinstance(writer.error, ZeroDivisionError)


def test_parts_of_all_ranks_are_one_file(tmp_path: Path) -> None:
    """Seven rows on three ranks: 2, 2 and 3. What a rank has not written yet is missing, not zero."""
    files = [SharedFile(SimpleNamespace(rank=rank, size=3), tmp_path / "bulk.h5") for rank in range(3)]
    rows, cuts = np.arange(14.0).reshape(7, 2), [0, 2, 4, 7]
    for rank, file in enumerate(files):
        here = slice(cuts[rank], cuts[rank + 1])
        file.write("points", rows[here], 7, units="m")
        for moment in range(2 if rank < 2 else 1):
            file.append("velocity", rows[here] + 100 * moment, 7, units="m/s")
        file.flush()
    with h5py.File(tmp_path / "bulk.h5") as whole:  # while they are written
        np.testing.assert_array_equal(whole["points"], rows)
        np.testing.assert_array_equal(whole["velocity"][0], rows)
        np.testing.assert_array_equal(whole["velocity"][1, :4], rows[:4] + 100)
        assert whole["velocity"].shape == (2, 7, 2) and np.isnan(whole["velocity"][1, 4:]).all()
        assert whole["velocity"].attrs["units"] == "m/s"
    for file in files:
        file.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bulk.0.h5", "bulk.1.h5", "bulk.2.h5", "bulk.h5"]


def test_rows_of_an_interface_are_in_order_whatever_rank_has_them() -> None:
    """Two ranks with every other point, the first rank with the end of the interface; a point that both have is owned
    by one. On lattices ranks follow x, so that no run there needs the order."""

    class TwoRanks:
        def gather(self, rows: np.ndarray, root: int) -> list[np.ndarray]:
            return [rows, np.array([[4.0, 0.4, 40.0], [0.0, 0.0, 0.0], [2.0, 0.2, 20.0]])]

    number, owned = np.array([5, 3, 4, 1]), np.array([True, True, False, True])
    columns = {"a": np.array([0.5, 0.3, 9.0, 0.1]), "b": np.array([50.0, 30.0, 9.0, 10.0])}
    rows = parallel.gather_fields(TwoRanks(), number, owned, columns)
    np.testing.assert_allclose(np.column_stack([*rows.values()]), np.outer(np.arange(6.0), [0.1, 10.0]), rtol=1e-15)


def test_a_snapshot_is_of_one_time() -> None:
    """All its fields are those of the velocity, in explicit runs half a step before the displacement of the state."""
    fields = BulkFields(Model(case({"order": 1})))
    state, x = fields.model.initial_state(), fields.model.coordinates
    state.displacement[:], state.velocity[:] = (1e-3 * x).ravel(), np.tile([3.0, -2.0], len(x))
    state.time, state.numbers["lag"] = 1e-6, 2e-7
    found = fields.gather(state)
    points = fields.topology().points
    np.testing.assert_allclose(found["velocity"], np.tile([3.0, -2.0], (len(x), 1)), rtol=1e-15)
    np.testing.assert_allclose(found["displacement"], 1e-3 * points - 1e-7 * np.array([3.0, -2.0]), rtol=0, atol=1e-18)


def test_a_table_keeps_the_rows_of_its_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "energy.csv"
    table = TableFile(path, ["a"], "s, then J")
    for time in (0.0, 1.0, 2.0):
        table.append(time, [10 + time])
    table.close()
    resumed = TableFile(path, ["a"], "s, then J", kept=1)
    resumed.append(1.5, [7.0])
    resumed.close()
    assert path.read_text().splitlines()[1:] == ["time,a", "0.0,10.0", "1.5,7.0"]


def test_fields_without_time_are_those_of_the_last_record(tmp_path: Path) -> None:
    """Two records that wait in one block: histories of both, and the later value of what has no history."""
    fault = Model(case({"order": 2})).faults[0]
    count = len(fault.interface.position)
    place = {"position": fault.interface.position}
    path, slip = tmp_path / "interface.h5", FIELDS[2]
    file = InterfaceFile(path, fault, place, {}, None, [slip])
    for number in (1.0, 2.0):
        file.append(number, {"slip": np.full(count, number), "rupture_time": np.full(count, 10 * number)})
    file.close()
    with h5py.File(path) as data:
        assert slip.name == "slip" and data["slip"][:, 0].tolist() == [1.0, 2.0]
        assert data["time"][:].tolist() == [1.0, 2.0] and set(data["rupture_time"][:]) == {20.0}


def test_the_expected_numbers_of_an_interface_are_those_of_its_file(tmp_path: Path) -> None:
    """Of every record all histories, the states of the law among them."""
    law = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6}
    given = case({"order": 2, "duration": 1e-6, "faults.main.friction": law, "faults.main.initial_stress.shear": 3.6e6})
    (records,) = (each for each in records_of(Model(given)) if isinstance(each, FaultRecords))
    simulate(given, tmp_path / "run", progress=False)
    with h5py.File(tmp_path / "run" / "interface.h5") as data:
        count = len(data["time"])
        histories = {name: item.size for name, item in data.items() if item.shape[:1] == (count,) and item.ndim == 2}
    assert count > 1 and "theta" in histories
    assert records.numbers(count, 5) == sum(histories.values())
