"""The section across a strike-slip fault answers slip as a half-space does: dislocations and their images."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from scipy import sparse
from scipy.sparse.linalg import spsolve

from benchmarks import bp1
from benchmarks._half_space_fault import HalfSpaceFault
from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.stepping.implicit.equilibrium import Equilibrium

pytestmark = pytest.mark.fem


def test_stress_of_slip_in_a_half_space() -> None:
    """Half a metre of displacement on one side around 10 km, edges at 400 km held: 1e-3 of the largest stress."""

    def slip(z: np.ndarray) -> np.ndarray:
        return np.exp(-(((z - 10e3) / 3e3) ** 2))

    model = Model(bp1.problem(250.0, 400e3), fem.MPI.COMM_SELF)
    face = model.faults[0].interface
    rows, columns, values = Equilibrium(model).tangent._stiffness.getValuesCSR()
    K = sparse.csr_matrix((values, columns, rows))
    u, free = np.zeros(K.shape[0]), ~model.loads.prescribed
    u[face.plus], free[face.plus] = slip(face.position) / 2, False
    u[free] = spsolve(K[free][:, free].tocsc(), -(K @ u)[free])
    # The weights of an antisymmetric interface are half of its area.
    found = -(K @ u)[face.plus] / (2 * face.weight)

    cells = np.linspace(0, bp1.FAULT, 1001)
    centres = 0.5 * (cells[1:] + cells[:-1])
    K = HalfSpaceFault(cells, centres, bp1.B, bp1.D_C, bp1.F_0, bp1.V_0, bp1.SIGMA, bp1.G, bp1.C_S, bp1.V_P,
                       bp1.initial_traction()).stiffness()  # fmt: skip
    inside = (face.position > 1e3) & (face.position < 38e3)
    expected = np.interp(face.position[inside], centres, K @ slip(centres))
    assert expected.min() == pytest.approx(-5.95e6, rel=1e-2)
    np.testing.assert_allclose(found[inside], expected, rtol=0, atol=1e-3 * np.abs(expected).max())
