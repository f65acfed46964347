"""Factorisation by MUMPS, or on one rank by PETSc's own LU where MUMPS is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from ruptfx.platform import fem
from ruptfx.stepping.implicit.preconditioners import Preconditioner

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.options import PetscOptions
    from ruptfx.stepping.implicit.tangent import Tangent

# Number of unknowns up to which the default is a factorisation, by dimension: fill grows faster in 3D.
DIRECT = {2: 400_000, 3: 60_000}
MOST = 10  # GMRES iterations with the factors of an earlier matrix, beyond which new ones are made
INEXACT = 1e-6  # relative residual of linear systems: Newton's iteration takes hardly more steps than with factors


def has_mumps() -> bool:
    """Return whether PETSc was built with MUMPS."""
    return bool(fem.PETSc.Sys.hasExternalPackage("mumps"))


def fits(model: System, unknowns: int) -> bool:
    """Return whether a matrix of so many unknowns is factorised by default."""
    return unknowns <= DIRECT[model.mesh.geometry.dim] and (has_mumps() or model.comm.size == 1)


def factorise(pc: fem.PETSc.PC) -> None:
    """Let a preconditioner factorise its matrix."""
    pc.setType("lu")
    if has_mumps():
        pc.setFactorSolverType("mumps")


class Lu(Preconditioner):
    """Factors of the assembled matrix."""

    order = 0
    iterative = False

    @classmethod
    def suits(cls, model: System) -> bool:
        return fits(model, model.total_nodes * model.components)

    @classmethod
    def set_up(cls, ksp: fem.PETSc.KSP, model: System, tangent: Tangent) -> None:
        ksp.setType("preonly")
        factorise(ksp.getPC())


class KeptFactors:
    """Factors of an earlier matrix as the preconditioner of GMRES, for steps in which few points slide.

    Sliding changes the matrix in every iteration of Newton's method, at the interfaces only. Products are those of the
    present matrix, so that the residual of a step does not depend on the age of the factors.

    Parameters
    ----------
    matrix : PETSc.Mat
        The assembled matrix of the steps.

    Attributes
    ----------
    factored : PETSc.Mat
        The matrix of the preconditioner.
    made : int
        Number of factorisations.
    """

    def __init__(self, matrix: fem.PETSc.Mat) -> None:
        self._matrix, self.factored, self.made = matrix, matrix.duplicate(), 0

    @classmethod
    def of(
        cls, matrix: fem.PETSc.Mat, preconditioner: type[Preconditioner], options: PetscOptions
    ) -> KeptFactors | None:  # fmt: skip
        """Return the factors for a matrix; None where it is not factorised, or the case chooses the linear solver.

        On several ranks every solution with MUMPS waits for messages, and is no longer cheap beside new factors: 1901
        solutions took three times the time of 446 factorisations (6500 unknowns in 2D, two ranks). There each matrix
        has its own factors.

        Parameters
        ----------
        matrix : PETSc.Mat
        preconditioner : type of Preconditioner
            That of the steps.
        options : dict
            Those of the case.
        """
        by_case = any(name.startswith(("ksp_", "pc_")) for name in options)
        return None if by_case or preconditioner.iterative or matrix.comm.size > 1 else cls(matrix)

    @staticmethod
    def set_up(ksp: fem.PETSc.KSP) -> None:
        """Set the defaults of a linear solver whose preconditioner is a factorisation."""
        ksp.setType("fgmres")  # a solution by the factors less than GMRES, and the residual is that of the system
        ksp.setTolerances(rtol=INEXACT, max_it=2 * MOST)

    def follow(self, ksp: fem.PETSc.KSP, enough: float) -> None:
        """Make new factors where those of the last solution took too many iterations; collective.

        Parameters
        ----------
        enough : float
            Residual [N] below which a solution need not go on.
        """
        if not self.made or ksp.getIterationNumber() > MOST:
            same = cast(Any, fem.PETSc.Mat.Structure.SAME_NONZERO_PATTERN)  # int in the stubs
            self._matrix.copy(self.factored, same)
            self.made += 1
        ksp.setTolerances(atol=enough)
