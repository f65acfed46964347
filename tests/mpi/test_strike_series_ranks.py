"""Sections that repeat along strike on any number of ranks: as those of one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.strike_cases import faulted

pytest.importorskip("dolfinx")

from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMPARED = ("slip_1", "slip_2", "slip_rate_1", "theta", "normal_stress", "shear_traction_1", "friction_work")


def test_same_on_any_number_of_ranks() -> None:
    case, ends = faulted(), {}
    for name, comm in (("all", fem.MPI.COMM_WORLD), ("one", fem.MPI.COMM_SELF)):
        model = Model(case, comm)
        motion, state = case.stepper.bind(model), model.initial_state()
        for _ in range(25):
            motion.step(state)
        face, fields = model.faults[0].interface, state.faults["main"]
        rows = np.column_stack([face.number, *(fields[key] for key in COMPARED)])[face.owned]
        everything = parallel.share_rows(comm, rows)
        energies = motion.energies(state)
        ends[name] = everything[np.argsort(everything[:, 0])], [state.time, *energies.values()]
    for ours, theirs in zip(ends["all"], ends["one"], strict=True):
        size = np.maximum(np.abs(theirs).max(axis=0), 1e-300)
        np.testing.assert_allclose(ours / size, theirs / size, atol=1e-9)
    assert len(ends["one"][0]) == 16 * 9 and np.ptp(ends["one"][0][:, 1]) > 1e-6  # m
