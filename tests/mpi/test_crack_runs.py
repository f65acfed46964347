"""Bodies that break: the same bits on 1, 2 and 3 ranks, and of a run that was stopped and resumed on others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.crack_cases import BRITTLE, SOFT, WEAK, block, faulted
from helpers.whole_runs import run_of, run_on, starts_jobs, stopped, write

from ruptfx.case import read_case
from ruptfx.interfaces.cracks.extrinsic import Extrinsic
from ruptfx.platform import fem
from ruptfx.results.record import Record
from ruptfx.run.recording.checkpoint import Checkpoint

pytestmark = starts_jobs


def same(first: Path, second: Path) -> None:
    """Cracks, events and motion, to the last bit."""
    with Record(first) as a, Record(second) as b:
        assert a.events.sizes["event"] > 5
        assert a.events.identical(b.events) and a.cracks.identical(b.cracks)
        for name in ("points", "displacement", "velocity"):
            assert np.array_equal(a.bulk[name].values, b.bulk[name].values), name
        np.testing.assert_allclose(a.edges.to_array(), b.edges.to_array(), rtol=1e-9, atol=1e-6)
        for record in (a, b):
            assert abs(record.energy.closure).max() < 1e-12


# The last checkpoint is written while facets fail.
case_file, alone = run_of(*(
    block({
        "fracture.kind": kind, "damping": {"mass": mass, "kelvin_voigt": {"fraction": 0.1}},
        "output.checkpoint_steps": steps,
    })
    # Nodes are moved on by other loops where masses are damped; facets of the last case have none.
    for kind, mass, steps in (("intrinsic", 0.0, 200), ("intrinsic", 1e3, 200), ("extrinsic", 1e3, 110))
), block({
    "fracture.default": {
        "cohesion": {**WEAK, "f_t": {"kind": "boxcar", "inside": 2e6, "outside": 4e6, "center": 5e-3,
                                     "half_width": 1e-3}},
        "friction": {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6,
                     "theta_initial": 1.0},
    }, "fracture.profiles_along": "y", "output.checkpoint_steps": 200,
}), faulted({
    "fracture.default.cohesion": BRITTLE, "mesh.element_size": 0.5e-3, "output.checkpoint_steps": 200,
    "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 0.1}],
}), *(faulted({
    "fracture.kind": "extrinsic", "faults.main.contact": contact, "fracture.default.cohesion": BRITTLE,
    "mesh.element_size": 0.5e-3, "output.checkpoint_steps": 80, "damping": {"kelvin_voigt": {"fraction": 0.1}},
    "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 0.1}],
}) for contact in (SOFT, {"kind": "split_node"})), marks=pytest.mark.slow)  # fmt: skip


@pytest.mark.parametrize("ranks", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_ranks_do_not_change_a_bit(ranks: int, case_file: Path, alone: Path, tmp_path: Path) -> None:
    same(alone, run_on(ranks, case_file, tmp_path / "run"))


@pytest.mark.faults
@pytest.mark.parametrize("ranks", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_run_goes_on_from_its_checkpoint_to_the_same_bits(
    ranks: int, case_file: Path, alone: Path, tmp_path: Path
) -> None:
    """The run as it was when its last checkpoint had been written, and on one rank or two from there."""
    out = stopped(alone, tmp_path / "run")
    found = Checkpoint.latest(fem.MPI.COMM_WORLD, out, read_case(case_file))
    assert found is not None and 0 < found.manifest["time"] < 9e-6
    same(alone, run_on(ranks, case_file, out, "--resume"))


@pytest.mark.faults
def test_a_run_goes_on_between_two_checks_of_the_strength(tmp_path: Path) -> None:
    """From a checkpoint at an odd step, when facets are inserted and the strength is checked at even steps."""
    case_file = write(tmp_path, block({"fracture.kind": "extrinsic", "output.checkpoint_steps": 115}))
    whole = run_on(1, case_file, tmp_path / "whole")
    out = stopped(whole, tmp_path / "run")
    found = Checkpoint.latest(fem.MPI.COMM_WORLD, out, read_case(case_file))
    assert found is not None and found.manifest["step"] % Extrinsic.model_fields["check_every"].default == 1
    same(whole, run_on(1, case_file, out, "--resume"))
