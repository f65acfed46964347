"""The bulk operator as a sparse matrix, the one that implicit steps factorise."""

from __future__ import annotations

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.operators import Bulk
from ruptfx.bodies.operators.ufl_form import energy, measure
from ruptfx.platform import fem


def stiffness_form(bulk: Bulk, degree: int | None = None) -> fem.dolfinx.fem.Form:
    """Return the compiled second derivative of the strain energy: K of linear materials.

    Parameters
    ----------
    bulk : Bulk
    degree : int, optional
        Degree of the polynomials that are integrated exactly; default: the quadrature of the element.
    """
    return fem.form(_second_derivative(bulk, degree=degree))


def is_linear(bulk: Bulk) -> bool:
    """Return whether the stiffness of the bodies is independent of the displacement."""
    displacement = fem.dolfinx.fem.Function(bulk.space)
    expanded = fem.ufl.algorithms.expand_derivatives(_second_derivative(bulk, displacement))
    return displacement not in expanded.coefficients()  # those that remain are parameters of materials


def _second_derivative(
    bulk: Bulk, displacement: fem.dolfinx.fem.Function | None = None, degree: int | None = None
) -> fem.ufl.Form:
    if displacement is None:
        displacement = fem.dolfinx.fem.Function(bulk.space)
    u, v = fem.ufl.TrialFunction(bulk.space), fem.ufl.TestFunction(bulk.space)
    stored = energy(bulk, displacement, measure(bulk, degree))
    return fem.ufl.derivative(fem.ufl.derivative(stored, displacement, v), displacement, u)


class Assembled:
    """K of the cells owned by a rank as a sparse matrix; any linear material, any mesh, any order.

    A matrix of order 4 has some 130 entries per row in 2D: slower than `matrix_free`, with equal results to round-off.
    """

    def __init__(self, bulk: Bulk) -> None:
        if bulk.large_rotations:
            raise RuptfxError(
                "assembled: with large rotations there is no one stiffness; operator = 'matrix_free', or 'ufl_form'"
            )
        self._stiffness = fem.local_matrix(stiffness_form(bulk))

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        force -= self._stiffness @ displacement
