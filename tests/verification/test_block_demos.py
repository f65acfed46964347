"""Blocks of `slip_sequence`, `thesis_block` and `sliding_to_rest`, on coarse elements: what their pages say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from ruptfx import read_case, simulate
from ruptfx.app.bench import slip_sequence, thesis_block
from ruptfx.app.bench.slip_sequence import EdgeAsperity, pushed
from ruptfx.app.bench.thesis_block import block
from ruptfx.bodies.boundaries.spring import Spring
from ruptfx.bodies.boundaries.traction import Traction
from ruptfx.case import Case
from ruptfx.platform import fem

pytestmark = pytest.mark.fem

DEMOS = Path(__file__).parents[2] / "demos"


@pytest.mark.slow
def test_a_machine_ten_times_as_stiff_moves_events_into_the_block() -> None:
    """The first event begins within the first element of 10 mm with the printed stiffness, beyond it with ten times it.

    At 9.45 and 5.7 s on the elements of the demo, where the places are 1 and 32 mm.
    """
    coarse = ("mesh.element_size=10e-3", "mesh.growth=1.0", "faults.main.friction.mu_s=0.4", "duration=12.5")
    cases = [pushed(machine=factor * slip_sequence.MACHINE, overrides=coarse) for factor in (1, 10)]
    first = [slip_sequence.sequence(case, fem.MPI.COMM_SELF).events[0] for case in cases]
    assert first[0].origin < 10e-3 < first[1].origin
    assert first[0].begin == 0.0 and first[0].reach < 70e-3 and 0 < first[0].drop < 0.15 * first[0].force


def machine_of(case: Case) -> tuple[Spring, Traction]:
    """The spring of the machine, and the traction that stands for the motion of its far end."""
    _, spring, motion = case.boundaries
    assert isinstance(spring, Spring) and isinstance(motion, Traction)
    return spring, motion


def test_the_pusher_has_the_stiffness_of_the_machine() -> None:
    """4 MN/m over 6 mm of width: k (top - bottom) 6 mm = 4 MN/m on any rows of elements; its far end moves 20 um/s."""
    for rows in slip_sequence.ROWS.values():
        spring, motion = machine_of(pushed(rows))
        assert spring.y_range is not None
        bottom, top = spring.y_range
        assert spring.normal * (top - bottom) * 6e-3 == pytest.approx(4e6)
        assert motion.traction[0] / motion.ramp / spring.normal == pytest.approx(20e-6)
        assert motion.y_range == spring.y_range
    named = [float(name) for name in slip_sequence.ROWS]
    middles = [500 * sum(machine_of(pushed(rows))[0].y_range or []) for rows in slip_sequence.ROWS.values()]
    np.testing.assert_allclose(middles, named, atol=0.05)
    base = read_case(DEMOS / "slip_sequence.toml")
    assert isinstance(base, Case)
    assert machine_of(base)[0].normal == pytest.approx(machine_of(pushed())[0].normal, rel=2e-3)


def test_the_asperity_ends_where_the_area_is_the_initial_one() -> None:
    """2 at the edge and falling by 0.1 per mm: 1 at 10 mm; the least is 0.6, at 14 mm, and 0.3 beyond the half."""
    x = np.arange(0, 0.041, 1e-3)
    area = np.where(x < 14.5e-3, 2 - 100 * x, np.where(x < 0.03, 0.9, 0.3))
    shape = EdgeAsperity.of(x, area)
    np.testing.assert_allclose([shape.extent, shape.peak, shape.least], [10e-3, 2.0, 0.6], rtol=1e-12)
    assert np.isnan(EdgeAsperity.of(x, np.full_like(x, 0.9)).extent)


def test_classes_of_roughness_are_normal() -> None:
    """Intervals of one standard deviation, 0.05, around 0.85: 38.29, 24.17, 6.06 and 0.60 %."""
    np.testing.assert_allclose(thesis_block.shares(), [0.60, 6.06, 24.17, 38.29, 24.17, 6.06, 0.60], atol=0.005)


def test_stress_between_the_fronts_is_compared_by_means() -> None:
    """-2 MPa; then -2 and +0.4 in turn at nine points from -15 to 65 mm: (5 x 2 - 4 x 0.4) / (9 x 2) = 0.4667."""
    x = np.arange(-95e-3, 100e-3, 10e-3)
    first, last = np.full(len(x), -2e6), np.where(np.arange(len(x)) % 2, 0.4e6, -2e6)
    nothing = np.zeros(len(x))
    stresses = [{"xx": values, "yy": nothing, "xy": nothing} for values in (first, first, last)]
    onset = thesis_block.Onset(x, nothing, np.abs(x - 75e-3), [0.0, 1.0, 2.0], stresses)
    assert onset.origin == pytest.approx(75e-3)
    assert thesis_block.relaxation(onset) == pytest.approx(8.4 / 18, rel=1e-12)


@pytest.mark.slow
def test_an_evenly_pressed_block_slips_first_at_its_left_corner() -> None:
    """Printed: -95 mm. The next points slip later the farther they are: a front, which accelerates."""
    even = thesis_block.onset(block("mesh.element_size=5e-3", "mesh.chamfer=5e-3", even=True), fem.MPI.COMM_SELF)
    assert even.origin == pytest.approx(-95e-3, abs=5e-3) and even.begin == pytest.approx(0.9e-3, abs=0.2e-3)
    places, speeds = even.edge_front()
    assert len(places) > 3 and speeds[-1] > 2 * speeds[0] and speeds[0] < 100


def test_the_block_of_the_demo_stops_when_the_closed_form_says(tmp_path: Path) -> None:
    """34.852 ms and 3.5349 mm (test_sliding_to_rest.py has the integrals)."""
    data = simulate(read_case(DEMOS / "sliding_to_rest.toml", ["output.figures=false"]), tmp_path / "run",
                    progress=False).interface.load()  # fmt: skip
    moves = data.slip_rate.mean("position").values > 1e-6
    assert float(data.time.values[moves][-1]) == pytest.approx(34.852e-3, abs=1.1e-4)
    assert float(data.slip.mean("position")[-1]) == pytest.approx(3.5349e-3, rel=1e-3)
