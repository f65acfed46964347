"""Slow loading until facets fail: the same on one rank and two, and of a run that was stopped and resumed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.crack_cases import joined_bar
from helpers.whole_runs import run_of, run_on, starts_jobs, stopped

from ruptfx.results.record import Record

pytestmark = starts_jobs
SOON = {"kind": "hybrid", "fast_above": 5e-4, "slow_below": 1e-4}  # explicit steps as soon as facets yield

case_file, alone = run_of(joined_bar(SOON, 20.0, 0.72e-3, {
    "mesh.element_size": 2e-3, "output.checkpoint_steps": 60, "output.interface_interval": 1e-5,
}))  # fmt: skip


@pytest.mark.slow
def test_ranks_agree(case_file: Path, alone: Path, tmp_path: Path) -> None:
    """Up to the tolerance of the solver of slow steps."""
    with Record(alone) as a, Record(run_on(2, case_file, tmp_path / "run")) as b:
        assert float(a.energy.fracture[-1]) > 0 and a.summary["steps"] > 120
        np.testing.assert_allclose(a.edges.to_array(), b.edges.to_array(), rtol=1e-6, atol=1e-3)
        for record in (a, b):
            assert abs(record.energy.closure).max() < 1e-9


@pytest.mark.faults
def test_a_run_goes_on_from_its_checkpoint_to_the_same_bits(case_file: Path, alone: Path, tmp_path: Path) -> None:
    """From its last checkpoint, in explicit steps."""
    with Record(alone) as a, Record(run_on(1, case_file, stopped(alone, tmp_path / "run"), "--resume")) as b:
        assert a.energy.identical(b.energy) and a.edges.identical(b.edges) and a.cracks.identical(b.cracks)
