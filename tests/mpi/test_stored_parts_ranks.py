"""Stored matrices of solid bodies on any number of ranks: a computation that ended early goes on bitwise the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import strike_slip

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import stored
from ruptfx.stepping.implicit.iterated import Iterated
from ruptfx.stepping.implicit.preconditioners import lu

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
FAR = [{"kind": "driven", "edge": f"{side}.far", "component": axis,
        "velocity": 1e-6 if (side, axis) == ("plus", "z") else 0.0}
       for side in ("plus", "minus") for axis in "xyz"]  # fmt: skip
FAULT = strike_slip({
    "order": 1, "mesh.element_size": 4e-3, "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "faults.main.friction": {
        "kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6,
    },
    "boundaries": FAR, "stepper": {"kind": "quasi_dynamic"}, "duration": 50.0,
})  # fmt: skip


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of rank 0, whose files count, as the cache of all ranks; solid bodies have no factors."""
    shared = COMM.bcast(tmp_path)
    monkeypatch.setattr(stored, "cache_directory", lambda: shared)
    monkeypatch.setitem(lu.DIRECT, 3, 0)
    return Path(shared)


def test_a_computation_that_ended_early_goes_on_bitwise(
    root: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Seven points of three components are solved for, and the next one is not; then the rest, then none."""
    caplog.set_level("INFO", "ruptfx.run")
    solve, end = Iterated.solve, [0]

    def counted(self: Iterated, right: np.ndarray) -> np.ndarray:
        end[0] -= 1
        if end[0] == 0:
            raise RuntimeError("killed")
        return solve(self, right)

    def run(last: int = 0) -> tuple[np.ndarray, np.ndarray, str]:
        """Return K of this rank, slip after three steps, and the line of the log of this rank."""
        end[0] = last
        case = parse_case(FAULT)
        model = Model(case, COMM)
        motion: Any = case.stepper.bind(model)
        line = next(text for text in reversed(caplog.messages) if "solutions for the matrix" in text)
        state = model.initial_state()
        for _ in range(3):
            motion.step(state)
        return motion._bodies._by_slip.copy(), state.faults["main"]["slip_1"].copy(), line

    monkeypatch.setattr(Iterated, "solve", counted)
    with pytest.raises(RuntimeError, match="killed"):
        run(3 * 7 + 2)
    assert COMM.bcast(len(list((root / "stiffness").iterdir()))) == 7
    resumed, slip, line = run()
    points = COMM.bcast(len(list((root / "stiffness").iterdir())))
    assert f": 7 read from {root / 'stiffness'}, the other {points - 7} computed" in line
    again, slip_again, line = run()
    assert f": all {points} read from {root / 'stiffness'}, none computed" in line
    monkeypatch.setattr(stored, "cache_directory", lambda: root / "fresh")
    fresh, slip_fresh, line = run()
    assert f": all {points} computed, and written to {root / 'fresh'}" in line
    for matrix, moved in ((resumed, slip), (again, slip_again)):
        np.testing.assert_array_equal(matrix, fresh)
        np.testing.assert_array_equal(moved, slip_fresh)
    assert np.abs(fresh).max() > 0 and COMM.allreduce(float(np.abs(slip_fresh).max(initial=0.0))) > 0


def test_parts_of_each_rank_are_counted_for_all(root: Path) -> None:
    """Every rank has two parts of its own, and all share one, of which each rank would count its own only."""
    for read in (False, True):
        parts = stored.StoredParts("of ranks", COMM, root / "own")
        for number in range(2):
            parts.part(f"{COMM.rank} {number}", (2,), lambda: np.ones(2), fem.MPI.COMM_SELF)
        parts.part("shared", (3,), lambda: np.zeros(3), COMM)
        count = 2 * COMM.size + 1
        assert parts.counts() == ((count, 0) if read else (0, count))
        assert f"all {count} {'read' if read else 'computed'}" in parts.report("matrices")
