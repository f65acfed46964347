"""PETSc's nonlinear and linear solvers with defaults that need no options, and options of the case.

Small systems are factorised. Large ones are solved by CG, or by GMRES while the matrix is unsymmetric, with multigrid
(`preconditioners`).
"""

from __future__ import annotations

from contextlib import nullcontext
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.input.schema import CaseError
from ruptfx.platform import fem, parallel
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.implicit.preconditioners import Preconditioner
from ruptfx.stepping.implicit.preconditioners.lu import Lu

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.step import Step
    from ruptfx.stepping.implicit.tangent import Tangent

TOLERANCE = 1e-10
MAX_NEWTON = 30
MORE_FILL: PetscOptions = {"mat_mumps_icntl_14": 50}  # room of MUMPS for fill that grows with pivoting [%]

_numbers = count()


class CaseOptions:
    """PETSc options of a case under a private prefix; unused options are reported.

    As a context it adds the options to PETSc's database; solvers read some of them at their first use.

    Parameters
    ----------
    given : dict
        Names without leading dash; ``true`` is an option without value.
    defaults : dict, optional
        Options that `given` overrides and that may remain unused.
    """

    def __init__(self, given: PetscOptions, defaults: PetscOptions | None = None) -> None:
        self.given, self.prefix = dict(given), f"ruptfx{next(_numbers)}_"
        self._all = {**(defaults or {}), **self.given}
        self.unread = ""

    def __enter__(self) -> CaseOptions:
        database: Any = fem.PETSc.Options()
        for name, value in self._all.items():
            database.setValue(self.prefix + name, None if value is True else value)
        return self

    def __exit__(self, *_: object) -> None:
        database = fem.PETSc.Options()
        unread = [name for name in self.given if not fem.option_was_read(self.prefix + name)]
        self.unread = f"stepper.petsc_options.{unread[0]} = {self.given[unread[0]]!r}" if unread else ""
        for name in self._all:
            database.delValue(self.prefix + name)


class NewtonSolver:
    """Solver of the full system: SNES, KSP and PC for the matrix of bodies and interfaces.

    Parameters
    ----------
    model : System
    tangent : Tangent
        Makes the matrix.
    preconditioner : type of Preconditioner
        That of the matrix.
    options : dict
        PETSc options of the case.

    Attributes
    ----------
    history : list of float
        Norm of the residual after every iteration of the last solve [N].
    iterations : int
        Iterations of the last solve.
    """

    outer = 1
    """A solve is one iteration of the multipliers."""

    def __init__(
        self, model: System, tangent: Tangent, preconditioner: type[Preconditioner], options: PetscOptions
    ) -> None:
        self._options = CaseOptions(options, MORE_FILL | preconditioner.defaults)
        self._model, self._tangent = model, tangent
        self._step: Step
        self._owned, self._ghosted = model.owned_nodes * model.components, fem.dolfinx.fem.Function(model.space)
        self._once = np.repeat(model.layout.once[: model.owned_nodes], model.components)
        self.history: list[float] = []
        self.iterations = 0
        matrix = tangent.matrix
        self._unknown = matrix.createVecRight()
        snes: Any = fem.PETSc.SNES()  # its annotations refuse mpi4py's communicators
        self.snes = snes.create(model.comm)
        self.snes.setOptionsPrefix(self._options.prefix)
        self.snes.setFunction(fem.callback(self._function), matrix.createVecLeft())
        self.snes.setJacobian(fem.callback(self._differentiate), matrix, matrix)
        self.snes.setTolerances(rtol=TOLERANCE, atol=0.0, stol=0.0, max_it=MAX_NEWTON)
        self.snes.setConvergenceTest(fem.callback(self._converged))
        self._ksp = self.snes.getKSP()
        preconditioner.set_up(self._ksp, model, tangent)
        self._preconditioner = preconditioner
        self._ready = False

    def solve(self, step: Step, u: np.ndarray) -> bool:
        """Solve `step` from `u` and evaluate it there; return whether it has an equilibrium; collective.

        Raises
        ------
        CaseError
            Unused options of the case.
        """
        self._step, self.history = step, []
        self._unknown.array[:] = u[: self._owned]
        with nullcontext() if self._ready else self._options:
            if not self._ready:
                self.snes.setFromOptions()
            self.snes.solve(None, self._unknown)
        if not self._ready and self._options.unread:
            raise CaseError(
                f"{self._options.unread}: the solvers in use (SNES {self.snes.getType()}, KSP {self._ksp.getType()}, "
                f"PC {self._ksp.getPC().getType()}) have no such option; correct or remove it"
            )
        self._ready = True
        self.iterations = self.snes.getIterationNumber()
        if self.snes.getConvergedReason() <= 0:
            return False
        self._visit(step, self._unknown.array_r)
        # Options of the case may let SNES end without a test, as snes_type = "ksponly" does.
        rtol, atol, _, _ = self.snes.getTolerances()
        residual = np.sqrt(parallel.total(self._model.comm, self._model.layout.owned_dot(step.residual, step.residual)))
        return bool(residual <= max(step.enough(rtol), atol))

    def _visit(self, step: Step, unknown: np.ndarray) -> None:
        """Evaluate the step at the owned unknowns unless that was done last; collective."""
        at = step.displacement[: self._owned]
        new = len(at) == 0 or not np.array_equal(at[self._once], unknown[self._once])
        if parallel.anywhere(self._model.comm, new):
            self._ghosted.x.array[: self._owned] = unknown
            self._ghosted.x.scatter_forward()
            self._model.layout.equalise(self._ghosted.x.array)
            step.evaluate(self._ghosted.x.array)

    def _function(self, _: fem.PETSc.SNES, x: fem.PETSc.Vec, out: fem.PETSc.Vec) -> None:
        """Evaluate R(u) for SNES."""
        self._visit(self._step, x.array_r)
        out.array[:] = self._step.residual[: self._owned]

    def _differentiate(self, _: fem.PETSc.SNES, x: fem.PETSc.Vec, *matrices: fem.PETSc.Mat) -> None:
        """Evaluate dR/du for SNES."""
        step = self._step
        self._visit(step, x.array_r)
        reactions = [reaction for _, _, reaction in step.reactions]
        symmetric = self._tangent.update(*step.key[:2], step.tangents, driven=self._tangent.unit, reactions=reactions)
        rtol, atol, _, _ = self.snes.getTolerances()
        self._preconditioner.follow(self._ksp, symmetric, self._options.given, max(step.enough(rtol), atol))

    def _converged(self, snes: fem.PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int | None:
        """Test the norm of the residual against that of the forces, as balancing forces may be zero at the start."""
        norm = norms[2]
        self.history.append(norm)
        rtol, atol, _, _ = snes.getTolerances()
        reasons = fem.PETSc.SNES.ConvergedReason
        if norm <= max(self._step.enough(rtol), atol):
            return reasons.CONVERGED_FNORM_RELATIVE
        return None

    @property
    def reason(self) -> str:
        """Return PETSc's name of the reason why the last solve ended."""
        code = self.snes.getConvergedReason()
        text = _name(fem.PETSc.SNES.ConvergedReason, code)
        return f"{text} ({_name(fem.PETSc.KSP.ConvergedReason, self._ksp.getConvergedReason())})"


def is_factorised(model: System) -> bool:
    """Return whether the default for the matrices of a model is a factorisation."""
    return Lu.suits(model)


def _name(reasons: object, code: int) -> str:
    return next((name for name, value in vars(reasons).items() if value == code and name.isupper()), str(code))
