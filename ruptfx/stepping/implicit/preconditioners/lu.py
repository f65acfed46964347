"""Factorisation by MUMPS, or on one rank by PETSc's own LU where MUMPS is missing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.platform import fem
from ruptfx.stepping.implicit.preconditioners import Preconditioner

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.tangent import Tangent

# Number of unknowns up to which the default is a factorisation, by dimension: fill grows faster in 3D.
DIRECT = {2: 400_000, 3: 60_000}


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
