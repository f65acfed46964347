"""Runs of an interface that slides: the same on any number of ranks, the same bits after a restart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.sliding_cases import rough
from helpers.whole_runs import assert_goes_on_with_the_same_bits, run_of, run_on, stopped

from ruptfx.case import parse_case
from ruptfx.interfaces.sliding.contact_states import contact_states
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

# Eight updates of who faces whom in about 400 steps, with impacts, friction and a viscous layer.
CHANGES = {
    "duration": 5e-6, "output.checkpoint_steps": 120, "output.interface_interval": 0.25e-6,
    "damping": {"mass": 1e5, "kelvin_voigt": {"fraction": 0.1}},
}  # fmt: skip


case_file, alone = run_of(rough(CHANGES))


def test_forces_of_a_run(alone: Path) -> None:
    """At every record; the parts make up the whole, and what is pressed is what the edge presses with, about."""
    with Record(alone) as record:
        times = record.interface.time.values
    table = np.loadtxt(alone / "forces.csv", delimiter=",", skiprows=2)
    np.testing.assert_allclose(table[:, 0], times, rtol=1e-12)
    np.testing.assert_allclose(table[:, 3:7].sum(axis=1), 1.0, rtol=1e-12)
    energy = Record(alone).energy
    for column, names in ((7, ["frictional_dissipation"]), (8, ["impact_loss", "pairing_update_loss"])):
        taken = sum(energy[name].values for name in names)
        assert taken[-1] > 0
        np.testing.assert_allclose(table[:, column], taken, rtol=1e-12, atol=1e-12 * taken.max())
    assert np.all(table[:, 6] == 0) and table[0, 5] == 1  # all faces something; at first all is open
    pressed = table[len(table) // 2 :]
    assert 0 < pressed[:, 5].mean() < 1 and pressed[:, 4].mean() > pressed[:, 3].mean()
    # 20 MPa on 1.2 mm, damped bodies that still ring.
    np.testing.assert_allclose(pressed[:, 1].mean(), 20e6 * 1.2e-3, rtol=0.5)
    # Flanks of slope up to 0.1 change the ratio of the forces by as much from that of friction.
    assert 0.15 < pressed[:, 2].mean() / pressed[:, 1].mean() < 0.45


def test_forces_as_means(tmp_path: Path) -> None:
    """Of all steps between two rows; over a restart with the same bits."""
    common = {**CHANGES, "duration": 1e-6, "output.checkpoint_steps": 30}
    simulate(parse_case(rough({**common, "output.interface_steps": 1})), tmp_path / "steps", progress=False)
    means = parse_case(rough({**common, "output.forces_interval": 0.21e-6}))
    simulate(means, tmp_path / "means", progress=False)
    every, table = (
        np.loadtxt(tmp_path / name / "forces.csv", delimiter=",", skiprows=2) for name in ("steps", "means")
    )
    assert len(table) == 5 and np.all(np.diff(table[:, 0]) > 0.15e-6)
    time, length = every[:, 0], np.diff(every[:, 0], prepend=0.0)
    begin = 0.0
    for middle, normal, shear, *parts in table:
        end = 2 * middle - begin
        within = (time > begin + 1e-12) & (time < end + 1e-12)
        share = length[within] / length[within].sum()
        np.testing.assert_allclose(parts, share @ every[within, 3:], atol=1e-12)
        # The mean frame is that of the whole time, not of every step.
        np.testing.assert_allclose([normal, shear], share @ every[within, 1:3], rtol=1e-3, atol=1e-3 * normal)
        begin = end
    np.testing.assert_allclose(begin, time[-1], rtol=1e-9)
    assert table[-1, 1] > 1e3
    simulate(means, stopped(tmp_path / "means", tmp_path / "resumed"), progress=False, resume=True)
    assert (tmp_path / "means" / "forces.csv").read_bytes() == (tmp_path / "resumed" / "forces.csv").read_bytes()


def test_states_and_surfaces_of_a_run(alone: Path) -> None:
    """What carries nothing is open; what is closed is where it faces; what is faced goes back as the points slide."""
    with Record(alone) as record:
        data = record.interface.load()
        table = record.forces
    assert data.contact.attrs["flag_meanings"].split() == ["open", "sticking", "sliding", "uncovered"]
    states, closed = data.contact.values, data.normal_stress.values > 0
    np.testing.assert_array_equal(states == 0, ~closed)
    assert np.isin(states[closed], [1, 2]).all() and (states == 2).any()
    rate = np.abs(data.slip_rate.values)
    assert np.median(rate[states == 1]) == 0 and np.median(rate[states == 2]) > 0.1
    # Records without a sticking point in the forces have none here, and the other way round.
    np.testing.assert_array_equal((states == 1).any(axis=1), table.sticking.values > 0)
    # What a point faces is a mean, up to 2.4 um beside it, on slopes up to 0.105.
    beside, above = (data.deformed_x - data.paired_x).values, (data.deformed_y - data.paired_y).values
    assert np.abs(above[closed]).max() < 0.25e-6 and np.abs(beside[closed]).max() < 2.5e-6
    apart = ~closed & (data.opening.values > 0)
    np.testing.assert_allclose(np.hypot(beside, above)[apart], data.opening.values[apart], atol=1.5e-6)
    assert data.opening.values[0].max() > 39e-6 and data.opening.values[-1].max() > 25e-6
    np.testing.assert_allclose(data.deformed_x[0], data.x, atol=1e-9)
    # What is faced goes back by the slip, but for what it is beside the point.
    gone = (data.paired_position - data.paired_position[0]).values
    np.testing.assert_allclose(gone, data.displacement_jump, atol=5e-6)
    assert gone.max() > 10e-6


def test_what_creeps_sticks() -> None:
    """Rate and state laws never stand still: what is slower than the threshold, either way, sticks."""
    fault = Model(parse_case(rough())).faults[0]
    state = fault.initial_state()
    state["normal_stress"][:-1] = 1e6  # the last one is open
    state["mean_slip_rate"][:] = np.linspace(-2e-3, 2e-3, len(state["normal_stress"]))
    found = contact_states(fault, state, 1e-3)
    assert found[-1] == 0 and {1, 2} == set(found[:-1])
    np.testing.assert_array_equal(found[:-1] == 2, np.abs(state["mean_slip_rate"][:-1]) > 1e-3)


@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_same_on_any_number_of_ranks(ranks: int, case_file: Path, alone: Path) -> None:
    """All ranks that own a part of the interface compute all its points, from the same bits."""
    out = run_on(ranks, case_file, case_file.parent / f"on_{ranks}")
    assert float(Record(alone).interface.slip.max()) > 5e-6
    assert max(largest_difference(alone, out).values()) < 1e-9


def test_goes_on_with_the_same_bits(case_file: Path, alone: Path) -> None:
    assert_goes_on_with_the_same_bits(case_file, alone, checkpoints=2)
