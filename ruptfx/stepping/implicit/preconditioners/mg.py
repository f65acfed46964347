"""Multigrid over polynomial orders, without a matrix of the bodies (PETSc's PCMG).

The levels are elements of order p, p/2, ..., 1 on the same mesh. Stiffness is applied by the bulk operator; what
interfaces, supports, inertia and dashpots add is a sparse matrix on the finest level, and its Galerkin product on the
others. Order 1 is assembled: factorised where it is small, else a cycle of GAMG with rigid motions as near null space.
Chebyshev polynomials smooth, with blocks of the nodes on both sides of an interface, so that a stiff contact does not
slow the iteration.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ruptfx.bodies.operators.assembled import is_linear
from ruptfx.bodies.operators.diagonal import has_diagonal
from ruptfx.bodies.operators.geometry import jacobian_at
from ruptfx.interfaces.mechanisms import responding
from ruptfx.platform import fem, parallel
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.implicit.preconditioners import LevelSize, Preconditioner
from ruptfx.stepping.implicit.preconditioners._levels import Level, make_levels
from ruptfx.stepping.implicit.preconditioners.lu import factorise, fits
from ruptfx.stepping.implicit.tangent import Tangent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ruptfx.bodies import operators
    from ruptfx.interfaces.mechanisms import Reaction
    from ruptfx.interfaces.mechanisms.system import System

CYCLES = 3  # of GAMG in a solution of order 1 that is not factorised
LEAST, MOST = 7, 12  # products with the matrix before and after every correction by a coarser level


ENTRY = 12  # bytes of an entry of a sparse matrix
VECTORS = 45  # of a level: those of the smoother and of its eigenvalues, diagonals, coordinates; as measured
FACTORS = {2: (100.0, 1.15), 3: (400.0, 4 / 3)}
"""By dimension c and p of the bytes c n^p of the factors of n unknowns of order 1; in 3D as measured."""


class MatrixFreeTangent(Tangent):
    """Matrix of a step as an operator: K is applied, and what is added to it is assembled.

    Attributes
    ----------
    levels : list of Level
        From the finest on, without that of order 1.
    coarse : CoarseLevel
    """

    def __init__(self, model: System, dashpot: np.ndarray) -> None:
        self.levels, self.coarse = make_levels(model)
        super().__init__(model, dashpot)
        self.matrix, added = self.levels[0].matrix, self.filled
        for level in self.levels:
            level.added = added
            added = level.added_to_next()
        self.coarse.make_room(added, self.levels[-1].interpolation)

    def _assemble(self, bulk: operators.Bulk) -> Any:
        """Return zeros with room for what is added to K."""
        if bulk is not self._model.bulk:
            return None  # damping is applied, too
        return fem.nodal_matrix(self._model.space, self.levels[0].groups, self.levels[0].tied)

    def _diagonal_of_elements(self) -> np.ndarray:
        return self.levels[0].diagonal

    def update(
        self, c_M: float, c_C: float, blocks: dict[str, np.ndarray], driven: float, springs: np.ndarray | None = None,
        reactions: Sequence[Reaction] = (),
    ) -> bool | None:  # fmt: skip
        symmetric = super().update(c_M, c_C, blocks, driven, springs, reactions)
        if symmetric is not None:
            viscosity = self._model.viscosity
            damped = 0.0 if viscosity is None else viscosity.eta * c_C
            for level in self.levels:
                level.renew(damped, driven)
                added = level.added_to_next()
            self.coarse.renew(added, damped, driven)
        return symmetric


class Mg(Preconditioner):
    """Levels of elements of lower order, for large bodies of quadrilaterals and hexahedra of order 2 and more."""

    order = 1
    unsymmetric: ClassVar[str] = "fgmres"
    defaults: ClassVar[PetscOptions] = {
        "mg_levels_ksp_chebyshev_kind": "opt_fourth", "mg_levels_esteig_ksp_max_it": 10,
        "mg_coarse_pc_gamg_threshold": 0.02,  # without it soft contact takes 18 iterations in place of 11
        "mg_coarse_pc_gamg_reuse_interpolation": False,  # the unknowns may change with the matrix
    }  # fmt: skip

    @classmethod
    def reason_against(cls, model: System) -> str:
        if model.order == 1 or not has_diagonal(model.bulk):
            return "levels of lower order need quadrilaterals or hexahedra of order 2 at least, and no axis"
        if responding(model.mechanisms):
            return "levels of lower order know neither attachments nor materials with memory"
        return "" if is_linear(model.bulk) else "levels of lower order need materials whose stiffness is constant"

    @classmethod
    def sizes(cls, model: System) -> list[LevelSize]:
        topology, c = model.mesh.topology, model.components
        dim, counts, order = topology.dim, [], model.order
        for entities in range(topology.dim + 1):
            topology.create_entities(entities)
            counts.append(topology.index_map(entities).size_global)
        levels = []
        while order >= 1:
            nodes = sum(count * (order - 1) ** entities for entities, count in enumerate(counts))
            unknowns = nodes * c
            size = float(unknowns * 8 * VECTORS + counts[-1] * (order + 1) ** dim * 4)
            if order > 1:
                size += unknowns * ENTRY * (c + _entries_of_interpolation(order) ** dim)
            else:
                matrix = unknowns * ENTRY * c * 3**dim
                factor, power = FACTORS[dim]
                size += 3 * matrix + (factor * unknowns**power if fits(model, unknowns) else 2 * matrix)
            levels.append(LevelSize(order, unknowns, size))
            order //= 2
        return levels

    @classmethod
    def make_tangent(cls, model: System, dashpot: np.ndarray) -> MatrixFreeTangent:
        return MatrixFreeTangent(model, dashpot)

    @classmethod
    def set_up(cls, ksp: fem.PETSc.KSP, model: System, tangent: Tangent) -> None:
        assert isinstance(tangent, MatrixFreeTangent)
        levels, coarse = [tangent.coarse, *tangent.levels[::-1]], tangent.coarse
        ksp.setType("cg")
        ksp.setTolerances(rtol=1e-7, max_it=200)
        norms: Any = fem.PETSc.KSP.NormType
        ksp.setNormType(norms.UNPRECONDITIONED)
        products = int(np.clip(np.round(2.5 * _mean_aspect_ratio(model)), LEAST, MOST))
        pc: Any = ksp.getPC()
        pc.setType("mg")
        pc.setMGLevels(len(levels))
        for number, level in enumerate(levels[1:], 1):
            assert isinstance(level, Level)
            pc.setMGInterpolation(number, coarse.interpolation if number == 1 else level.interpolation)
            smoother = pc.getMGSmoother(number)
            smoother.setType("chebyshev")
            smoother.setTolerances(max_it=products)
            smoother.setOperators(level.matrix, level.matrix)
            level.precondition(smoother.getPC())
        solver = pc.getMGCoarseSolve()
        solver.setOperators(coarse.matrix, coarse.matrix)
        solver.setType("preonly")
        if fits(model, coarse.layout.total * model.components):
            factorise(solver.getPC())
        else:
            solver.setType("richardson")
            solver.setTolerances(max_it=CYCLES, rtol=0.0)
            solver.setNormType(norms.NONE)
            solver.getPC().setType("gamg")


def _entries_of_interpolation(order: int) -> float:
    """Return the mean number of nodes of half the order along a line from which a node is interpolated."""
    coarse = order // 2
    shared = 1 + (order % 2 == 0 and coarse % 2 == 0)  # a corner, and the middle where both have a node there
    return (shared + (order - shared) * (coarse + 1)) / order


def _mean_aspect_ratio(model: System) -> float:
    """Return the mean ratio of the longest and the shortest edge direction of the elements; collective."""
    mesh = model.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    middle = np.full((1, mesh.topology.dim), 0.5)
    sizes = [np.linalg.norm(jacobian_at(mesh, cells, middle)[:, 0], axis=-1)
             for cells in np.array_split(np.arange(owned), 1 + owned // 10_000)]  # fmt: skip
    ratios = [float((size.max(axis=1) / size.min(axis=1)).sum()) for size in sizes if len(size)]
    total, count = parallel.total(model.comm, [sum(ratios), owned])
    return float(total / count)
