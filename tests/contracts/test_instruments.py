"""Every instrument of the folder, by its own example: in every stepper, at the times it promises, on any ranks."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_cases import COMPLIANT, case, unstressed
from test_steppers import ANY_STEPPER, required

pytest.importorskip("dolfinx")

from ruptfx import fem, simulate
from ruptfx.case import Case, parse_case
from ruptfx.model import Model
from ruptfx.record import Record
from ruptfx.recording.sampling import Samples
from ruptfx.schema import CaseError, alternatives

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
INSTRUMENTS = alternatives("ruptfx.instruments")
STEPPERS = alternatives("ruptfx.steppers")
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
        return
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
                assert np.isfinite(variable).all() and variable.attrs["units"] and variable.attrs["long_name"]
        ends = [float(record.instruments["point"][name][-1]) for name in ("displacement_x", "strain_xx")]
        assert ends[0] < -1e-9 and ends[1] < -1e-7  # pushed to the left


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
    with pytest.raises(CaseError, match=r"instruments\.0\.interval = 1e-09 s: below the time step of .* make it long"):
        Samples(model, given.stepper.bind(model).dt, unstressed)


@every_instrument
def test_names_are_their_own(kind: str) -> None:
    with pytest.raises(CaseError, match=r"instruments\.1\.name = '\w+': another instrument has that name"):
        with_instruments([example(kind), example(kind)])


def test_they_resume_bitwise(shared_tmp_path: Path) -> None:
    """A run that goes on from its last checkpoint, without its file, leaves the file of one that was never stopped."""
    tables = [{**table, "interval": 3.7e-7} for table in map(example, INSTRUMENTS)]
    given = with_instruments(tables, {"output.checkpoint_steps": 10})
    whole, cut = shared_tmp_path / "whole", shared_tmp_path / "cut"
    simulate(given, whole, COMM, progress=False)
    simulate(given, cut, COMM, progress=False)
    if COMM.rank == 0:
        (cut / "summary.json").unlink()
        (cut / "instruments.h5").write_bytes(b"cut off")
    COMM.barrier()
    simulate(given, cut, COMM, progress=False, resume=True)
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            for name, data in one.instruments.items():
                assert data.sizes["time"] == 17  # 6 us / 0.37 us = 16.2, and the start
                assert data.identical(other.instruments[name])
