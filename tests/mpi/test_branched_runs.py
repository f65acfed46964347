"""A fault with a branch on several ranks: the fields of one rank, in two and in three dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import SOFT, beside_branches
from helpers.small_cases import branched

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from ruptfx.case import parse_case
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
SURFACE = {
    "plane": "solid", "order": 2,
    "mesh": {"kind": "extruded", "thickness": 2e-3, "layers": 2, "section": branched()["mesh"]},
    "faults.main.initial_stress.shear": {
        "kind": "rectangle", "inside": 3.9e6, "outside": 3e6, "strike": [-6e-3, -2e-3], "dip": [0.5e-3, 3e-3],
    },
}  # fmt: skip


FIELDS = ("slip", "slip_rate", "shear_traction", "normal_stress", "rupture_time")


def run(table: dict[str, Any], comm: fem.MPI.Comm, steps: int) -> tuple[list[np.ndarray], dict[str, float]]:
    """Fields and weights of every fault in the order along it, and the energies."""
    parsed = parse_case(table)
    model = Model(parsed, comm)
    motion, state = parsed.stepper.bind(model), model.initial_state()
    for _ in range(steps):
        motion.step(state)
    found = []
    for fault in model.faults:
        face, fields = fault.interface, state.faults[fault.name]
        for name in FIELDS:
            values = fields[name][:, None] if name in fields else fault.components(fields, name)
            rows = parallel.share_rows(comm, np.column_stack([face.number, values])[face.owned])
            rows = rows[np.argsort(rows[:, 0])]
            assert np.array_equal(rows[:, 0], np.arange(face.total))
            found.append(rows[:, 1:])
        weights = parallel.share_rows(comm, np.column_stack([face.number, face.weight])[face.owned])
        found.append(weights[np.argsort(weights[:, 0]), 1:])
    return found, motion.energies(state)


@pytest.mark.parametrize("changes, steps", [
    ({}, 500), (SURFACE, 350), (beside_branches("intrinsic", {"kind": "split_node"}), 290),
    (beside_branches("extrinsic", SOFT), 196), (beside_branches("extrinsic", {"kind": "split_node"}), 190),
], ids=["2D", "3D", "2D, intrinsic facets", "2D, extrinsic facets", "2D, extrinsic facets, rigid contact"])  # fmt: skip
def test_the_same_as_on_one_rank(changes: dict[str, Any], steps: int) -> None:
    alone, energy = run(branched(changes), fem.MPI.COMM_SELF, steps)
    together, same = run(branched(changes), COMM, steps)
    for expected, found in zip(alone, together, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.nanmax(np.abs(expected)))
    size = max(map(abs, energy.values()))
    assert all(abs(same[name] - energy[name]) < 1e-10 * size for name in energy)
    assert energy["frictional_dissipation"] > 0.1 * size
    assert (energy["fracture"] > 0) == ("fracture" in changes)
