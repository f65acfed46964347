"""Steps of PETSc's TS on any number of ranks: those of one rank, and the slip of leapfrog."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import impact

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
STEPS, DURATION = 120, 6e-6


def slip(stepper: dict[str, Any], comm: Any) -> np.ndarray:
    """Return the slip of all points at the end, in the order of the points [m]."""
    changes = {"order": 2, "duration": DURATION, "mesh.length": 12e-3, "mesh.height": 4e-3,
               "stepper": {**stepper, "time_step": DURATION / STEPS}}  # fmt: skip
    case = parse_case(impact(6e6, 2.0, changes=changes))
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    for _ in range(STEPS):
        motion.step(state)
    assert abs(state.time - DURATION) < 1e-9 * DURATION  # no step is shorter than asked for
    face, fields = model.faults[0].interface, state.faults["main"]
    rows = np.column_stack([face.number, fields["slip"] + state.lag * fields["slip_rate"]])[face.owned]
    rows = parallel.share_rows(comm, rows)
    return np.asarray(rows[np.argsort(rows[:, 0]), 1])


@pytest.mark.parametrize("scheme", ["alpha2", "basicsymplectic", "rk"])
def test_slip_is_that_of_one_rank_and_of_leapfrog(scheme: str) -> None:
    ours = slip({"kind": "petsc_ts", "scheme": scheme}, COMM)
    alone, theirs = slip({"kind": "petsc_ts", "scheme": scheme}, fem.MPI.COMM_SELF), slip({"kind": "leapfrog"}, COMM)
    assert theirs.max() > 1e-6
    np.testing.assert_allclose(ours, alone, rtol=0, atol=1e-8 * theirs.max())
    assert np.linalg.norm(ours - theirs) < 0.02 * np.linalg.norm(theirs)
