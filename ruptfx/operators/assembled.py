"""The bulk operator as a matrix: what implicit steps factorise, here applied to vectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx import fem
from ruptfx.operators import Bulk
from ruptfx.operators.ufl_form import energy, measure


def stiffness_form(bulk: Bulk, factor: Any = 1) -> Any:
    """The compiled second derivative of the strain energy times a factor: K of linear materials."""
    displacement = fem.dolfinx.fem.Function(bulk.space)
    u, v = fem.ufl.TrialFunction(bulk.space), fem.ufl.TestFunction(bulk.space)
    stored = energy(bulk, displacement, measure(bulk), factor)
    return fem.bilinear(fem.ufl.derivative(fem.ufl.derivative(stored, displacement, v), displacement, u))


class Assembled:
    """K of the cells a rank owns as a sparse matrix; any linear material, any mesh, any order.

    A matrix of order 4 has some 130 entries per row in 2D: slower than `matrix_free`, and the same to round-off.
    """

    def __init__(self, bulk: Bulk) -> None:
        self._stiffness = fem.local_matrix(stiffness_form(bulk))
        self._damping = None
        if bulk.viscosity_time is not None:
            # K of every cell times its viscosity time.
            cellwise = fem.dolfinx.fem.functionspace(bulk.space.mesh, ("DG", 0))
            eta = fem.dolfinx.fem.Function(cellwise)
            dofs = cellwise.dofmap.list[:, 0]
            eta.x.array[dofs] = bulk.viscosity_time[: len(dofs)]
            self._damping = fem.local_matrix(stiffness_form(bulk, eta))

    def add_internal_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        force -= self._stiffness @ displacement
        if self._damping is not None:
            force -= self._damping @ velocity
