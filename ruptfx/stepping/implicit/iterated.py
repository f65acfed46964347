"""Solutions of bodies that are too large to be factorised: conjugate gradients with multigrid."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.platform import fem
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.solvers import CaseOptions

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.preconditioners import Preconditioner
    from ruptfx.stepping.implicit.tangent import Tangent

RESIDUAL = 1e-11  # over the load: a tenth of the tolerance of a step
MOST = 300  # iterations
PER_UNKNOWN = 2e-5  # processor time of a solution over the number of unknowns [s]


class Iterated:
    """A symmetric matrix with the interface of `compliance.Decomposed`, whose solutions are iterated.

    Parameters
    ----------
    model : System
    tangent : Tangent
        Its matrix, assembled or not.
    preconditioner : type of Preconditioner
        That of the matrix.
    fill : callable
        Fills the matrix; it is called before every solution, as the tangent has only one matrix for all lengths of
        steps, and does nothing where the matrix is unchanged.

    Attributes
    ----------
    iterations : list of int
        Of every solution.
    """

    def __init__(
        self, model: System, tangent: Tangent, preconditioner: type[Preconditioner], fill: Callable[[], object]
    ) -> None:
        self.given, self._fill, self._unknowns = tangent.matrix, fill, model.total_nodes * model.components
        self.iterations: list[int] = []
        options = CaseOptions({}, preconditioner.defaults)
        made: Any = fem.PETSc.KSP()  # its annotations refuse mpi4py's communicators
        self._ksp = made.create(model.comm)
        self._ksp.setOptionsPrefix(options.prefix)
        self._ksp.setOperators(self.given, self.given)
        fill()
        preconditioner.set_up(self._ksp, model, tangent)
        preconditioner.follow(self._ksp, True, {})
        self._ksp.setNormType(fem.PETSc.KSP.NormType.UNPRECONDITIONED)
        self._ksp.setTolerances(rtol=RESIDUAL, atol=0.0, max_it=MOST)
        with options:
            self._ksp.setFromOptions()
            self._ksp.setUp()
        self._right, self._left = self.given.createVecLeft(), self.given.createVecRight()

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution for the entries of this rank; collective.

        Raises
        ------
        ConvergenceError
            On all ranks.
        """
        self._fill()
        self._right.array[:] = right
        self._ksp.solve(self._right, self._left)
        self.iterations.append(self._ksp.getIterationNumber())
        if self._ksp.getConvergedReason() <= 0:
            load = self._right.norm()
            raise ConvergenceError(
                f"bodies of {self._unknowns} unknowns: after {self.iterations[-1]} iterations of conjugate gradients "
                f"with {self._ksp.getPC().getType()} the residual is {self._ksp.getResidualNorm() / load:.3g} of the "
                f"load, {RESIDUAL:g} is required; let boundaries hold every body, make elements less long than they "
                "are wide, or use larger elements"
            )
        return np.asarray(self._left.array_r)

    def solve_all(self, right: np.ndarray) -> np.ndarray:
        """Return the solutions for several columns, of the entries of this rank; collective."""
        return np.stack([self.solve(column).copy() for column in right.T], axis=1)

    def destroy(self) -> None:
        """Free the solver; collective."""
        self._ksp.destroy()
