"""Algebraic multigrid on the assembled matrix, with rigid motions as near null space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.platform import fem
from ruptfx.stepping.implicit.preconditioners import Preconditioner

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.tangent import Tangent


class Gamg(Preconditioner):
    """PETSc's GAMG, for any body."""

    order = 2

    @classmethod
    def set_up(cls, ksp: fem.PETSc.KSP, model: System, tangent: Tangent) -> None:
        ksp.setType("cg")
        ksp.setTolerances(rtol=1e-7, max_it=2000)
        ksp.getPC().setType("gamg")
        tangent.matrix.setNearNullSpace(rigid_motions(model.coordinates[: model.owned_nodes], tangent.matrix))


def rigid_motions(x: np.ndarray, matrix: fem.PETSc.Mat, jumps: np.ndarray | None = None) -> fem.PETSc.NullSpace:
    """Return translations and rotations of the owned unknowns, as the near null space of a stiffness.

    Parameters
    ----------
    x : ndarray, shape (owned nodes, dim)
        Coordinates [m].
    matrix : PETSc.Mat
        Its block size is the number of components.
    jumps : ndarray of bool, shape (owned nodes, components), optional
        Unknowns that are jumps, which a rigid motion does not have.
    """
    c = matrix.getBlockSize()
    modes = [np.tile(np.eye(c)[k], (len(x), 1)) for k in range(c)]
    for i, j in {2: [(0, 1)], 3: [(0, 1), (1, 2), (2, 0)]}.get(c, []):
        turn = np.zeros((len(x), c))
        turn[:, i], turn[:, j] = -x[:, j], x[:, i]
        modes.append(turn)
    vectors: list[fem.PETSc.Vec] = []
    for mode in modes:
        vector = matrix.createVecRight()
        vector.array[:] = (mode if jumps is None else np.where(jumps, 0.0, mode)).ravel()
        for other in vectors:  # orthonormal, as PETSc wants them
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        vectors.append(vector)
    return fem.PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm)
