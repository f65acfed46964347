"""Every instrument of the folder, by its own example: in every stepper, at the times it promises, on any ranks."""

from __future__ import annotations

import tomllib
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import ANY_STEPPER, COMPLIANT, SPLIT, case, required, two_boxes, unstressed

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.units import check_units
from helpers.whole_runs import whole_and_resumed

from ruptfx import simulate
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.platform import fem, parallel
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.sampling import Samples

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
INSTRUMENTS = alternatives("ruptfx.readings.instruments")
PRESENT = ("fault_receiver", "load_cell", "receiver", "receiver_grid", "strain_gauge", "velocimeter")
"""Kinds whose units the table has."""
STEPPERS = alternatives("ruptfx.stepping.steppers")
every_instrument = pytest.mark.parametrize("kind", INSTRUMENTS)


def example(kind: str) -> dict[str, Any]:
    """What the instrument gives as an example."""
    return tomllib.loads(f"instrument = {INSTRUMENTS[kind].example}")["instrument"]


def with_instruments(tables: list[dict[str, Any]], changes: dict[str, Any] | None = None) -> Case:
    """Two glued plates that are pushed."""
    push = {"kind": "traction", "edge": "upper.right", "traction": [-1e6, 5e5], "ramp": 1e-6}
    return case({
        "order": 2, "duration": 6e-6, "instruments": tables, "faults.main.contact": COMPLIANT,
        "boundaries": [push, {"kind": "driven", "edge": "lower.bottom", "component": "y", "velocity": 0.0},
                       {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": 0.0}],
        "output.interface_interval": 1e-6, **(changes or {}),
    })  # fmt: skip


@every_instrument
def test_written_and_read_again(kind: str) -> None:
    given = with_instruments([example(kind)])
    again = parse_case(tomllib.loads(given.to_toml()))
    assert example(kind)["kind"] == kind
    assert again == given and again.hash == given.hash


@pytest.mark.parametrize("stepper", STEPPERS)
def test_all_of_them_in_every_stepper(stepper: str, shared_tmp_path: Path) -> None:
    """Samples at the multiples of the interval until the end; something moves, and every number has a unit."""
    changes = {"stepper": {"kind": stepper, **required(stepper)}, "faults.main.friction": ANY_STEPPER}
    plain = with_instruments([], changes)
    interval = 1e-6 * np.ceil(plain.stepper.bind(Model(plain)).dt / 1e-6)
    if plain.stepper.adaptive:
        interval = 2e-7
    tables = [{**example(kind), "interval": interval} for kind in INSTRUMENTS]
    given = with_instruments(tables, changes)
    simulate(given, shared_tmp_path / stepper, COMM, progress=False)
    if COMM.rank > 0:
        pytest.skip("rank 0 reads the files")
    with Record(shared_tmp_path / stepper) as record:
        assert list(record.instruments) == [table["name"] for table in tables]
        for table in tables:
            data = record.instruments[table["name"]]
            count = 1 + int(6e-6 / interval * (1 + 1e-9))
            # Implicit steps do not know the acceleration at their end.
            assert data.sizes["time"] in ((count - 1, count) if table["kind"] == "load_cell" else (count,))
            np.testing.assert_allclose(data.time, interval * np.arange(data.sizes["time"]), rtol=1e-12)
            assert len(data.data_vars) > 0
            for variable in data.data_vars.values():
                assert np.isfinite(variable).all() and variable.attrs["long_name"]
        ends = [float(record.instruments["point"][name][-1]) for name in ("displacement_x", "strain_xx")]
        assert ends[0] < -1e-9 and ends[1] < -1e-7  # pushed to the left
        # New kinds have the units that they say.
        own = tuple(str(name) for table in tables if table["kind"] not in PRESENT
                    for name in record.instruments[table["name"]].data_vars)  # fmt: skip
    assert check_units(shared_tmp_path / stepper, but=own) > len(tables)


@every_instrument
def test_the_same_on_any_number_of_ranks(kind: str) -> None:
    """Weights of all ranks, on a displacement and a velocity that depend on the place only, give what one rank has."""
    model = Model(with_instruments([example(kind)]))
    alone = Model(with_instruments([example(kind)]), fem.MPI.COMM_SELF)
    found = [_readings(each) for each in (model, alone)]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9, atol=1e-9 * np.abs(found[1]).max())
    assert np.abs(found[1]).max() > 0


def _readings(model: Model) -> np.ndarray:
    """Of two states, one time after the other, as samples."""
    samples, state = Samples(model, 1e-7, unstressed), model.initial_state()
    state.numbers["lag"] = 0.0
    x, y = model.coordinates.T
    for step in range(5):
        state.time = 1e-7 * step
        wave = [np.sin(300 * x + 200 * y + step), np.cos(500 * x - 100 * y)]
        state.displacement[:] = np.stack(wave, axis=1).ravel()
        state.velocity[:] = step**2 * state.displacement
        for fault in model.faults:
            state.faults[fault.name]["slip"][:] = step * np.sin(300 * fault.interface.position)
        samples.observe(state)
    blocks = samples.gather()
    values = np.concatenate([np.array(columns).ravel() for _, _, columns in blocks]) if blocks else np.zeros(0)
    return np.array(model.comm.bcast(values, root=0))


@every_instrument
def test_an_interval_below_the_step_is_refused(kind: str) -> None:
    given = with_instruments([{**example(kind), "interval": 1e-9}])
    model = Model(given)
    with pytest.raises(
        CaseError, match=facts(r"instruments\.0\.interval = 1e-09 s: below the time step of .* make it long")
    ):
        Samples(model, given.stepper.bind(model).dt, unstressed)


@every_instrument
def test_names_are_their_own(kind: str) -> None:
    with pytest.raises(CaseError, match=facts(r"instruments\.1\.name = '\w+': another instrument has that name")):
        with_instruments([example(kind), example(kind)])


@pytest.mark.parametrize("stepper", STEPPERS)
def test_they_resume_bitwise(stepper: str, shared_tmp_path: Path) -> None:
    """A run that goes on after half of its time, without its file, leaves the file of one that was never stopped."""
    changes = {"stepper": {"kind": stepper, **required(stepper)}, "faults.main.friction": ANY_STEPPER}
    plain = with_instruments([], changes)
    model = Model(plain)
    motion, state = plain.stepper.bind(model), model.initial_state()
    if 10 * motion.dt > 6e-6 and "time_step" in type(plain.stepper).model_fields:
        changes = changes | {"stepper.time_step": 6e-7}
        motion = with_instruments([], changes).stepper.bind(model)
    interval = 3.7e-7 if 20 * motion.dt < 6e-6 or plain.stepper.adaptive else 1.01 * motion.dt
    while state.time < 0.6 * plain.duration:
        motion.step(state)
    tables = [{**table, "interval": interval} for table in map(example, INSTRUMENTS)]
    given = with_instruments(tables, {**changes, "output.checkpoint_steps": state.step})
    whole, cut = whole_and_resumed(given, shared_tmp_path / f"{stepper}_resumed", "instruments.h5")
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            for name, data in one.instruments.items():
                assert data.sizes["time"] >= 6e-6 / interval - 1
                same = other.instruments[name]
                assert data.identical(same) or stepper == "petsc_ts"
                # PETSc's TS rounds its times otherwise when it begins anew.
                for signal, values in data.data_vars.items():
                    size = 1e-13 * float(np.abs(values).max())
                    np.testing.assert_allclose(same[signal].values, values.values, rtol=0, atol=size)


def boxes(tables: list[dict[str, Any]]) -> Case:
    """Two boxes, 4 x 3 x 2 mm each, whose interface slides along both tangents."""
    given = case({
        "plane": "solid", "order": 2, "duration": 4e-6, "faults.main.contact": SPLIT, "instruments": tables,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.3, "mu_d": 0.2, "D_c": 1e-6},
        "faults.main.initial_stress": {"tensor": [0.0, 0.0, -6e6, 0.0, 1.2e6, 1.7e6]},
        "output.interface_interval": 1e-6, "stepper.time_step": 1e-7,
    })  # fmt: skip
    return given.substituted({"mesh": two_boxes()})


def test_a_fault_receiver_at_a_point_of_a_plane(shared_tmp_path: Path) -> None:
    """At a node it has what the record has; between nodes it gives any field of the elements, both tangents apart."""
    node, between = [1e-3, 1.5e-3, 0.0], [1.3e-3, 1.9e-3, 0.0]
    tables = [{"kind": "fault_receiver", "name": name, "interval": 1e-6, "point": point}
              for name, point in (("node", node), ("between", between))]  # fmt: skip
    given = boxes(tables)
    model = Model(given)
    samples, state, face = Samples(model, 1e-7, unstressed), model.initial_state(), model.faults[0].interface
    x, y, _ = face.points.T
    fields = {"slip_1": 1 + 300 * x - 200 * y + 4e4 * x * y, "shear_traction_2": 1e6 + 2e8 * y + 5e10 * x**2}
    for step in (0, 1, 2):
        state.time = state.numbers["fault_time"] = 1e-6 * step
        for name, values in fields.items():
            state.faults["main"][name][:] = values
        samples.observe(state)
    gathered = samples.gather()
    simulate(given, shared_tmp_path / "boxes", COMM, progress=False)
    if COMM.rank > 0:
        pytest.skip("rank 0 reads the files")
    channels = dict(zip(("node", "between"), (found for _, found in samples.instruments), strict=True))
    for (name, _, columns), (a, b, _) in zip(gathered, (node, between), strict=True):
        values = dict(zip((channel.name for channel in channels[name]), columns, strict=True))
        assert values["slip_1"][-1] == pytest.approx(1 + 300 * a - 200 * b + 4e4 * a * b, rel=1e-9)
        assert values["shear_traction_2"][-1] == pytest.approx(1e6 + 2e8 * b + 5e10 * a**2, rel=1e-9)
        assert values["slip_2"][-1] == 0
    with Record(shared_tmp_path / "boxes") as record:
        data, there = record.instruments["node"], record.interface
        assert data.slip_rate_2.attrs["long_name"] == "slip rate along tangent 2, (0, 1, 0)"
        number = int(np.argmin(np.hypot(there.x.values - node[0], there.y.values - node[1])))
        for name in ("slip_1", "slip_2", "slip_rate_1", "shear_traction_1", "shear_traction_2", "normal_stress"):
            seen, known = data[name].values[1:], there[name].values[1 : data.sizes["time"], number]
            np.testing.assert_allclose(seen, known, rtol=1e-9, atol=1e-15)
        slips = float(data.slip_1[-1]), float(data.slip_2[-1])
        assert min(slips) > 1e-6 and slips[0] != pytest.approx(slips[1], rel=0.1)


def test_a_point_beside_the_plane_is_moved_to_its_nearest_node(caplog: pytest.LogCaptureFixture) -> None:
    """As stations on the mean plane of a rough fault are; every channel says so."""
    model = Model(boxes([]))
    face, readings = model.faults[0].interface, ModelReadings(model, unstressed)
    rows = parallel.share_rows(COMM, np.column_stack([face.number, face.points])[face.owned])
    node = rows[rows[:, 0] == 7, 1:][0]

    def channels(point: np.ndarray) -> list[tuple[str, dict[int, float]]]:
        """Return the text of every channel and its weights by the number of the point."""
        listed = []
        for channel in readings.at_fault("main", point.tolist(), "here", "point"):
            (share,) = channel.shares
            weights = zip(face.number[share.places].tolist(), share.weights.tolist(), strict=True)
            listed.append((channel.long_name, dict(chain.from_iterable(COMM.allgather(list(weights))))))
        return listed

    at, beside = channels(node), channels(node + np.array([0.0, 0.0, 1e-4]))
    assert at and len(at) == len(beside)
    for (exact, one), (moved, other) in zip(at, beside, strict=True):
        assert {key: weight for key, weight in one.items() if abs(weight) > 1e-9} == {7: pytest.approx(1)}
        assert other == {7: 1.0}
        assert moved.startswith(exact) and moved.endswith(" 0.0001 m away")
    assert caplog.text.count(" 0.0001 m away") == 1


@pytest.mark.parametrize("table,message", [
    ({"point": [1e-3, 1e-3, 2e-3]},
     r"point = \(0\.001, 0\.001, 0\.002\) m: is not on interface 'main', whose nearest node is \(0\.001, 0\.0"),
    ({"point": [1e-3, 1.0, 0.0]}, r"is not on interface 'main', whose nearest node is \(0\.001, 0\.003, 0\) m"),
    ({"position": 1e-3}, r"instruments\.0\.point and position = 0\.001: in 3D give the point"),
    ({"point": [1e-3, 1e-3]}, r"point"),
])  # fmt: skip
def test_points_that_are_not_on_the_plane(table: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        Samples(Model(boxes([{"kind": "fault_receiver", "name": "one", "interval": 1e-6, **table}])), 1e-8, unstressed)
    with pytest.raises(CaseError, match=facts("in 2D give the position along the interface, alone")):
        with_instruments([{"kind": "fault_receiver", "name": "one", "interval": 1e-6, "point": [0.0, 0.0, 0.0]}])
