"""Moduli and wave speeds beside interfaces on several ranks: those of one rank."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, branched, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

WOVEN = {"kind": "orthotropic_elastic", "density": 1600.0, "E_1": 130e9, "E_2": 9e9, "nu_12": 0.3, "nu_23": 0.4,
         "G_12": 5e9, "angle": 0.3}  # fmt: skip
STEPPED = {"kind": "along_axis", "axis": "x",
           "profile": {"kind": "layers", "boundaries": [4e-3, 8e-3], "values": [2e9, 5e9, 9e9]}}  # fmt: skip


def columns(table: dict[str, Any], comm: fem.MPI.Comm) -> list[Any]:
    model, found = Model(parse_case(table), comm), []
    for fault in model.faults:
        face, sides = fault.interface, sides_of(model, fault.interface)
        rows = np.column_stack([face.number, *sides.columns().values()])[face.owned]
        rows = parallel.share_rows(comm, rows)
        found += [rows[np.argsort(rows[:, 0])], sides.bodies]
    return found


@pytest.mark.parametrize("table", [
    plates({"materials.upper": HOMALITE | {"young_modulus": STEPPED}, "materials.lower": WOVEN}), branched(),
], ids=["two bodies", "branched"])  # fmt: skip
def test_the_same_as_on_one_rank(table: dict[str, Any]) -> None:
    if table["mesh"]["kind"] == "branched_fault":
        pytest.importorskip("gmsh")
    alone, together = columns(table, fem.MPI.COMM_SELF), columns(table, fem.MPI.COMM_WORLD)
    for expected, found in zip(alone, together, strict=True):
        if isinstance(expected, dict):
            assert found == {name: pytest.approx(values, rel=1e-12) for name, values in expected.items()}
        else:
            assert np.isfinite(expected).all()
            np.testing.assert_allclose(found, expected, rtol=1e-11)
