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
from ruptfx.stepping.implicit.preconditioners.lu import KeptFactors

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
STEPS, DURATION = 120, 6e-6


def march(stepper: dict[str, Any], comm: Any) -> tuple[np.ndarray, Any]:
    """Return the slip of all points at the end, in the order of the points [m], and the stepper bound to the model."""
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
    return np.asarray(rows[np.argsort(rows[:, 0]), 1]), motion


def slip(stepper: dict[str, Any], comm: Any) -> np.ndarray:
    """Return the slip of all points at the end, in the order of the points [m]."""
    return march(stepper, comm)[0]


@pytest.mark.parametrize("scheme", ["alpha2", "basicsymplectic", "rk"])
def test_slip_is_that_of_one_rank_and_of_leapfrog(scheme: str) -> None:
    ours = slip({"kind": "petsc_ts", "scheme": scheme}, COMM)
    alone, theirs = slip({"kind": "petsc_ts", "scheme": scheme}, fem.MPI.COMM_SELF), slip({"kind": "leapfrog"}, COMM)
    assert theirs.max() > 1e-6
    np.testing.assert_allclose(ours, alone, rtol=0, atol=1e-8 * theirs.max())
    assert np.linalg.norm(ours - theirs) < 0.02 * np.linalg.norm(theirs)


def test_kept_factors_give_the_slip_of_new_ones_and_of_generalized_alpha() -> None:
    """On one rank the first factors precondition every matrix; on several, and by options, each has its own."""
    stepper = {"kind": "petsc_ts", "scheme": "alpha2"}
    alone, motion = march(stepper, fem.MPI.COMM_SELF)
    assert motion._kept.made == 1
    options = {"petsc_options": {"ksp_type": "preonly"}}
    by_case, motion = march({**stepper, **options}, COMM)
    assert motion._kept is None
    theirs = slip({"kind": "generalized_alpha"}, COMM)  # the same scheme, at other times of the tractions
    assert np.linalg.norm(alone - theirs) < 1e-3 * np.linalg.norm(theirs)
    np.testing.assert_allclose(alone, by_case, rtol=0, atol=1e-8 * theirs.max())
    matrix = motion._equilibrium.tangent.matrix
    kept = KeptFactors.of(matrix, motion._equilibrium.preconditioner, {})
    assert (kept is None) == (COMM.size > 1)
