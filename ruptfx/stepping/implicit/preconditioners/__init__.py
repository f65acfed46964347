"""Preconditioners of implicit steps, one per file; the file name is PETSc's `pc_type` that chooses it.

A preconditioner makes the matrix of the steps, assembled or not, and sets the defaults of the linear solver for it;
options of the case replace them. Other types of PETSc get the assembled matrix.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ruptfx.input.schema import CaseError
from ruptfx.platform import fem, parallel
from ruptfx.platform.memory import refuse_shortage
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.implicit.tangent import Tangent

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System

BELOW = 0.1  # part of the tolerated residual of a step that a linear solution may leave


class LevelSize(NamedTuple):
    """Size of a level of multigrid, estimated before it is made.

    Attributes
    ----------
    order : int
        Of the elements.
    unknowns : int
    bytes : float
        Of matrices, vectors and, on the coarsest level, factors, all ranks together.
    """

    order: int
    unknowns: int
    bytes: float


class Preconditioner:
    """The contract of a preconditioner.

    Attributes
    ----------
    order : int
        The first one in ascending order that suits a model is its default.
    iterative : bool
        False for factorisations.
    unsymmetric : str
        KSP type while the matrix is unsymmetric, of iterative solvers.
    defaults : dict
        PETSc options of the linear solver that a case overrides.
    """

    order: ClassVar[int]
    iterative: ClassVar[bool] = True
    unsymmetric: ClassVar[str] = "gmres"
    defaults: ClassVar[PetscOptions] = {}

    @classmethod
    def reason_against(cls, model: System) -> str:
        """Return why it cannot be used for a model; empty if it can; collective."""
        return ""

    @classmethod
    def suits(cls, model: System) -> bool:
        """Return whether it is a good choice for a model for which it can be used; collective."""
        return True

    @classmethod
    def sizes(cls, model: System) -> list[LevelSize]:
        """Return the sizes of levels that it makes from the model on, from the finest on; collective."""
        return []

    @classmethod
    def make_tangent(cls, model: System, dashpot: np.ndarray) -> Tangent:
        """Return the matrix of the steps of a model."""
        return Tangent(model, dashpot)

    @classmethod
    def set_up(cls, ksp: fem.PETSc.KSP, model: System, tangent: Tangent) -> None:
        """Set the defaults of a linear solver with the matrix of `make_tangent`; collective."""
        raise NotImplementedError

    @classmethod
    def follow(cls, ksp: fem.PETSc.KSP, symmetric: bool | None, options: PetscOptions, enough: float = 0.0) -> None:
        """Prepare a linear solver for the next solution.

        Parameters
        ----------
        ksp : PETSc.KSP
        symmetric : bool or None
            Whether the matrix is symmetric; None if it has not changed.
        options : dict
            Those of the case.
        enough : float
            Residual [N] below which the solution need not go on.
        """
        if cls.iterative and symmetric is not None and "ksp_type" not in options:
            ksp.setType("cg" if symmetric else cls.unsymmetric)
        norm: Any = ksp.getNormType()
        if cls.iterative and norm == fem.PETSc.KSP.NormType.UNPRECONDITIONED:
            ksp.setTolerances(atol=BELOW * enough)


@cache
def kinds() -> Mapping[str, type[Preconditioner]]:
    """Return the preconditioners in the files of this folder by name, in their order."""
    names = [each.name for each in pkgutil.iter_modules(__path__) if not each.name.startswith("_")]
    classes: dict[str, Any] = {name: getattr(import_module(f"{__name__}.{name}"), name.capitalize()) for name in names}
    return dict(sorted(classes.items(), key=lambda item: item[1].order))


def choose(model: System, options: PetscOptions) -> type[Preconditioner]:
    """Return the preconditioner that options name, else the first that suits a model; collective.

    Raises
    ------
    CaseError
        Options that name one which cannot be used.
    """
    known = kinds()
    name = options.get("pc_type")
    if name is None:
        return next(each for each in known.values() if not each.reason_against(model) and each.suits(model))
    chosen = known.get(str(name), known["gamg"])
    reason = chosen.reason_against(model)
    if reason:
        raise CaseError(f"stepper.petsc_options.pc_type = '{name}': {reason}; remove it, or use 'gamg'")
    return chosen


def need_memory(model: System, kind: type[Preconditioner]) -> None:
    """Refuse levels of multigrid that do not fit into the memory, before one is made; collective.

    Raises
    ------
    RuptfxError
        On all ranks; the message gives the memory and the remedy.
    """
    levels = kind.sizes(model)
    if not levels:
        return
    need = sum(level.bytes for level in levels) * parallel.ranks_here(model.comm) / model.comm.size
    part = {2: "a quarter", 3: "an eighth"}[model.mesh.geometry.dim]
    refuse_shortage(
        model.comm, "mesh", f"{levels[0].unknowns} unknowns of implicit steps", need,
        f"twice the mesh.element_size takes {part} of it. Else let elements grow away from the interface "
        "(mesh.growth), or spread the ranks over several machines", " in the levels of multigrid",
    )  # fmt: skip
