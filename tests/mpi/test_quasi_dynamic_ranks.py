"""Quasi-dynamic steps on any number of ranks: as those of one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import case, memory_friction, merged, plates

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.case import parse_case
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
COMPARED = ("slip", "slip_rate", "mean_slip_rate", "theta", "normal_stress", "shear_traction", "friction_work")
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]


GIVEN = {
    "order": 2, "duration": 50.0, "mesh.length": 12e-3, "mesh.element_size": 2e-3,
    "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "faults.main.friction": {
        "kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6,
    },
    "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6},
    "boundaries": [*HELD, {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1e-6}],
    "stepper": {"kind": "quasi_dynamic"},
}  # fmt: skip


MEMORY = {
    "faults.main.friction": memory_friction("P1"), "faults.main.initial_stress.shear": 3.7e6, "duration": 1e-5,
}  # fmt: skip


@pytest.mark.parametrize("changes", [{}, MEMORY], ids=["age", "two states"])
def test_same_on_any_number_of_ranks(changes: dict[str, Any]) -> None:
    given = parse_case(merged(plates(GIVEN), changes))
    found = {}
    for name, comm in (("all", COMM), ("one", fem.MPI.COMM_SELF)):
        model = Model(given, comm)
        motion, state = given.stepper.bind(model), model.initial_state()
        for _ in range(12):
            motion.step(state)
        face, fields = model.faults[0].interface, state.faults["main"]
        rows = np.column_stack([face.number, *(fields[key] for key in COMPARED if key in fields)])[face.owned]
        everything = parallel.share_rows(comm, rows)
        energies = motion.energies(state)
        found[name] = everything[np.argsort(everything[:, 0])], [state.time, *energies.values()]
    for ours, theirs in zip(found["all"], found["one"], strict=True):
        size = np.maximum(np.abs(theirs).max(axis=0), 1e-300)
        np.testing.assert_allclose(ours / size, theirs / size, atol=1e-9)
    assert np.ptp(found["one"][0][:, 1]) > 1e-9  # m


def test_a_point_without_balance_is_an_error_on_all_ranks() -> None:
    given = case(GIVEN)
    model = Model(given, COMM)
    motion, state = given.stepper.bind(model), model.initial_state()
    face = model.faults[0].interface
    state.faults["main"]["theta"][face.number == 3] = np.nan
    with pytest.raises(ConvergenceError, match=facts(r"point 3 of fault 'main' at .* time 0 s")) as caught:
        motion.step(state)
    assert len(set(COMM.allgather(str(caught.value)))) == 1 and state.time == 0
