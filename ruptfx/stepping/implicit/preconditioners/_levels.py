"""Levels of multigrid: the bodies in elements of lower order on the same mesh."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from ruptfx.bodies import operators
from ruptfx.bodies.operators.assembled import stiffness_form
from ruptfx.bodies.operators.diagonal import stiffness_diagonal
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.bodies.space.variation import Variation
from ruptfx.interfaces.faults.interface import build_interface
from ruptfx.platform import fem, parallel
from ruptfx.stepping.implicit.preconditioners.gamg import rigid_motions

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System

EXACT = 3  # degree of the quadrature of order 1: that of the Galerkin product on parallelepipeds


class _Context:
    """Functions of a PETSc object that is written in Python; it keeps no reference to their objects."""

    def __init__(self, **functions: Any) -> None:
        for name, function in functions.items():
            setattr(self, name, fem.callback(function))


class Space:
    """Bodies of one level.

    Attributes
    ----------
    layout : Nodes
    bulk : Bulk
    viscous : Bulk or None
        Elements with Kelvin-Voigt damping.
    fixed : ndarray of bool, shape (nodes * components,)
        Degrees of freedom without an equation: of driven nodes, and of copies of tied ones.
    """

    def __init__(self, model: System, layout: Nodes, bulk: operators.Bulk, fixed: np.ndarray) -> None:
        self.model, self.layout, self.bulk = model, layout, bulk
        self.viscous = None if model.viscosity is None else replace(bulk, only=model.viscosity.bulk.only)
        self.fixed = fixed.copy()
        self.fixed.reshape(layout.count, -1)[layout.copies] = True
        self.owned = layout.owned * layout.components

    @property
    def tied(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Pairs of tied nodes; None without any on all ranks."""
        return (self.layout.kept, self.layout.copies) if self.layout.bodies.ties else None


class Level(Space):
    """A level without a matrix of its bodies.

    Attributes
    ----------
    matrix : PETSc.Mat
        K and what is added to it, as an operator.
    added : PETSc.Mat
        What interfaces, supports, inertia and dashpots add.
    diagonal : ndarray, shape (owned * components,)
        Of K [N/m].
    interpolation : PETSc.Mat
        From the next coarser level.
    groups : list of ndarray, shape (n, k)
        Local nodes that interfaces and supports couple.
    """

    interpolation: Any
    added: Any = None

    def __init__(
        self, model: System, layout: Nodes, bulk: operators.Bulk, fixed: np.ndarray, groups: list[np.ndarray]
    ) -> None:
        super().__init__(model, layout, bulk, fixed)
        finest = layout is model.layout
        self._operator = model.operator if finest else operators.create("matrix_free", bulk)
        self._damping: operators.Operator | None = None
        if self.viscous is not None:
            assert model.viscosity is not None
            self._damping = model.viscosity.operator if finest else operators.create("matrix_free", self.viscous)
        self.groups, self._damped, self._unit = groups, 0.0, 1.0
        self._x, self._y = (fem.dolfinx.fem.Function(layout.space) for _ in range(2))
        self.diagonal = self._summed_diagonal(bulk)
        self._viscous_diagonal = 0.0 if self.viscous is None else self._summed_diagonal(self.viscous)
        size: Any = (self.owned, None)
        context = _Context(mult=self._multiply, getDiagonal=self._get_diagonal)
        self.matrix: Any = fem.PETSc.Mat()
        self.matrix.createPython((size, size), context, comm=layout.comm)
        self.matrix.setUp()
        self._smoother = _Context(apply=self._apply_blocks)
        self._clusters = _clusters(groups, layout.count)
        self._inverse = np.zeros(self.owned)
        self._blocks: list[tuple[np.ndarray, np.ndarray]] = []
        self._product: Any = None  # storage of the Galerkin product for the next level

    def _summed_diagonal(self, bulk: operators.Bulk) -> np.ndarray:
        diagonal = stiffness_diagonal(bulk)
        self.layout.sum_shared(diagonal)
        return np.asarray(self.layout.reduce_tied(diagonal)[: self.owned])

    def _multiply(self, _: object, x: fem.PETSc.Vec, y: fem.PETSc.Vec) -> None:
        """Multiply by the matrix: K x of the equations, and what is added."""
        layout, u, force = self.layout, self._x.x, self._y.x
        u.array[: self.owned] = x.array_r
        u.scatter_forward()
        u.array[self.fixed] = 0.0
        layout.equalise(u.array)
        force.array[:] = 0.0
        self._operator.add_internal_force(u.array, force.array)
        if self._damped and self._damping is not None:
            self._damping.add_internal_force(self._damped * u.array, force.array)
        force.scatter_reverse(fem.dolfinx.la.InsertMode.add)
        if self.tied is not None:
            force.scatter_forward()
            force.array[:] = layout.reduce_tied(force.array)
        force.array[self.fixed] = 0.0
        self.added.mult(x, y)
        fixed = self.fixed[: self.owned]
        y.array[:] = np.where(fixed, self._unit * x.array_r, y.array_r - force.array[: self.owned])

    def _get_diagonal(self, _: object, out: fem.PETSc.Vec) -> None:
        self.added.getDiagonal(out)
        out.array[:] = np.where(self.fixed[: self.owned], self._unit, out.array_r + self._of_equations())

    def _of_equations(self) -> np.ndarray:
        """Return the diagonal of K with damping, zero where there is no equation [N/m]."""
        return np.where(self.fixed[: self.owned], 0.0, self.diagonal + self._damped * self._viscous_diagonal)

    # -- smoother ------------------------------------------------------------------------------------------------

    def precondition(self, pc: fem.PETSc.PC) -> None:
        """Set the preconditioner of the smoother: the diagonal, and blocks of nodes that interfaces couple."""
        pc.setType("python")
        pc.setPythonContext(self._smoother)

    def renew(self, damped: float, unit: float) -> None:
        """Compute what depends on the matrix that is added; collective.

        Parameters
        ----------
        damped : float
            Factor of the stiffness of damped elements.
        unit : float
            Diagonal entry where there is no equation.
        """
        self._damped, self._unit = damped, unit
        diagonal = self.matrix.createVecRight()
        self._get_diagonal(None, diagonal)
        self._inverse = 1 / diagonal.array
        self._invert_blocks()
        self.matrix.assemble()  # PETSc estimates eigenvalues again

    def _invert_blocks(self) -> None:
        c, numbers = self.layout.components, self.layout.space.dofmap.index_map
        ghosted = self._x.x
        ghosted.array[: self.owned] = self._of_equations()
        ghosted.scatter_forward()
        of_bodies = ghosted.array.copy()
        dofs = [(cluster[..., None] * c + np.arange(c)).reshape(len(cluster), -1) for cluster in self._clusters]
        nodes = np.concatenate([np.zeros(0, dtype=np.int64), *(cluster.ravel() for cluster in self._clusters)])
        rows = numbers.local_to_global(nodes.astype(np.int32))[:, None] * c + np.arange(c)
        order = np.argsort(rows.ravel())
        index_set: Any = fem.PETSc.IS()
        index_set.createGeneral(rows.ravel()[order].astype(fem.PETSc.IntType), comm=fem.MPI.COMM_SELF)
        entries = self.added.createSubMatrices(index_set, index_set)[0]
        start, column, value = entries.getValuesCSR()
        local = csr_array((value, column, start), shape=(rows.size, rows.size))
        place = np.empty(rows.size, dtype=np.int64)
        place[order] = np.arange(rows.size)
        self._blocks, first = [], 0
        for each in dofs:
            count, size = each.shape
            chosen = place[first : first + each.size].reshape(count, size)
            first += each.size
            pairs = np.broadcast_arrays(chosen[:, :, None], chosen[:, None, :])
            block = np.asarray(local[pairs[0].ravel(), pairs[1].ravel()]).reshape(count, size, size)
            diagonal = block[:, range(size), range(size)] + of_bodies[each]
            block[:, range(size), range(size)] = np.where(self.fixed[each], self._unit, diagonal)
            self._blocks.append((each, np.linalg.inv(block)))

    def _apply_blocks(self, _: object, x: fem.PETSc.Vec, y: fem.PETSc.Vec) -> None:
        ghosted = self._x.x
        y.array[:] = self._inverse * x.array_r
        ghosted.array[: self.owned] = x.array_r
        if self.layout.comm.size > 1:
            ghosted.scatter_forward()
        for dofs, inverse in self._blocks:
            result = np.einsum("nij,nj->ni", inverse, ghosted.array[dofs])
            own = dofs < self.owned
            y.array[dofs[own]] = result[own]

    def added_to_next(self) -> Any:
        """Return what is added on the next coarser level: the Galerkin product; collective."""
        if self._product is None:
            self._product = self.added.PtAP(self.interpolation)
        else:
            self.added.PtAP(self.interpolation, result=self._product)
        return self._product


class CoarseLevel(Space):
    """The level of order 1, assembled; its unknowns are displacements or, at stiff interfaces, means and jumps.

    Algebraic multigrid aggregates nodes across a stiff interface that do not move together. In means and jumps of the
    two sides the stiffness of the interface is on the diagonal, which the smoother takes into account.

    Attributes
    ----------
    matrix : PETSc.Mat
    interpolation : PETSc.Mat
        From the unknowns to the next finer level.
    """

    matrix: Any = None
    interpolation: Any = None
    _sum: Any

    def __init__(
        self, model: System, layout: Nodes, bulk: operators.Bulk, fixed: np.ndarray, faces: list[Interface]
    ) -> None:
        super().__init__(model, layout, bulk, fixed)
        none = np.zeros((0, 2), dtype=np.int64)
        self._bodies = fem.matrix(stiffness_form(bulk, EXACT), none, self.tied)
        self._viscous = None
        if self.viscous is not None:
            self._viscous = fem.matrix(stiffness_form(self.viscous, EXACT), none, self.tied)
        c, numbers = layout.components, layout.space.dofmap.index_map
        own = np.flatnonzero(self.fixed[: self.owned])
        self._rows = (numbers.local_to_global((own // c).astype(np.int32)) * c + own % c).astype(fem.PETSc.IntType)
        for each in (self._bodies, self._viscous):
            if each is not None:
                each.zeroRowsColumns(self._rows, diag=0.0)
        self._pairs = _pairs(faces, layout.count)
        self._stiff = np.zeros((len(self._pairs), c), dtype=bool)
        self._basis: Any = fem.nodal_matrix(layout.space, [self._pairs])
        self._fill_basis()

    def make_room(self, added: Any, finer: Any) -> None:
        """Make the matrices, with room for what is added; collective.

        Parameters
        ----------
        finer : PETSc.Mat
            Interpolation of displacements to the next finer level.
        """
        self._sum = self._bodies.duplicate(copy=True)
        self._sum.axpy(1.0, added, fem.PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._sum.setOption(fem.PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self._finer, self.interpolation = finer, finer.matMult(self._basis)
        self.matrix = self._sum.ptap(self._basis)
        self._set_rigid_motions()

    def renew(self, added: Any, damped: float, unit: float) -> None:
        """Compute the matrix; collective.

        Parameters
        ----------
        added : PETSc.Mat
            What is added to the stiffness of the bodies.
        damped : float
            Factor of the stiffness of damped elements.
        unit : float
            Diagonal entry where there is no equation.
        """
        structure = fem.PETSc.Mat.Structure
        self._sum.zeroEntries()
        self._sum.axpy(1.0, self._bodies, structure.SUBSET_NONZERO_PATTERN)
        if damped and self._viscous is not None:
            self._sum.axpy(damped, self._viscous, structure.SUBSET_NONZERO_PATTERN)
        of_bodies = self._sum.getDiagonal()
        self._sum.axpy(1.0, added, structure.SUBSET_NONZERO_PATTERN)
        self._sum.zeroRowsColumns(self._rows, diag=unit)
        self._choose_basis(of_bodies.array, added.getDiagonal().array)
        self._sum.ptap(self._basis, result=self.matrix)

    def _choose_basis(self, bodies: np.ndarray, added: np.ndarray) -> None:
        """Use means and jumps where both diagonals of a pair are mostly those of the interface; collective."""
        ghosted = fem.dolfinx.fem.Function(self.layout.space)
        ghosted.x.array[: self.owned] = (added > bodies) & ~self.fixed[: self.owned]
        ghosted.x.scatter_forward()
        stiff = (ghosted.x.array.reshape(self.layout.count, -1)[self._pairs] > 0).all(axis=1)
        if parallel.anywhere(self.layout.comm, not np.array_equal(stiff, self._stiff)):
            self._stiff = stiff
            self._fill_basis()
            self._finer.matMult(self._basis, result=self.interpolation)
            self._set_rigid_motions()

    def _fill_basis(self) -> None:
        """Set the map from the unknowns to displacements; collective.

        A pair has its mean in the place of the first node, and its jump in that of the second.
        """
        c, numbers = self.layout.components, self.layout.space.dofmap.index_map
        made, insert = self._basis, fem.PETSc.InsertMode.INSERT_VALUES
        ones = made.createVecLeft()
        ones.set(1.0)
        made.setDiagonal(ones)
        made.assemble()
        places = numbers.local_to_global(self._pairs.ravel().astype(np.int32)).reshape(-1, 2)
        for pair, stiff in zip(places.astype(fem.PETSc.IntType), self._stiff, strict=True):
            block = np.eye(2 * c)
            block[:c, c:], block[c:, :c] = np.diag(0.5 * stiff), np.diag(1.0 * stiff)
            block[c:, c:] -= np.diag(1.5 * stiff)
            made.setValuesBlocked(pair, pair, block, addv=insert)
        made.assemble()

    def _set_rigid_motions(self) -> None:
        """Set the near null space of the matrix, in which jumps are zero; collective."""
        jumps = np.zeros((self.layout.count, self.layout.components), dtype=bool)
        jumps[self._pairs[:, 1]] = self._stiff
        owned = slice(self.layout.owned)
        self.matrix.setNearNullSpace(rigid_motions(self.layout.coordinates[owned], self.matrix, jumps[owned]))


def _pairs(faces: list[Interface], count: int) -> np.ndarray:
    """Return local nodes on both sides of interfaces, shape (n, 2), without those where interfaces meet."""
    pairs = [cluster for cluster in _clusters(_groups_of(faces), count) if cluster.shape[1] == 2]
    return np.concatenate([np.zeros((0, 2), dtype=np.int64), *pairs])


def make_levels(model: System) -> tuple[list[Level], CoarseLevel]:
    """Return the levels of a model, from the finest on, and that of order 1; collective."""
    fixed = model.loads.prescribed
    # Sliding contact is not part of the matrix of the bodies (`surfaces`).
    names = [fault.name for fault in model.faults if not fault.slides]
    groups = _groups_of(fault.interface for fault in model.faults if not fault.slides)
    groups += [support.nodes[:, None] for support in model.loads.supports]
    finest = Level(model, model.layout, model.bulk, fixed, groups)
    levels: list[Level] = [finest]
    order = model.order // 2
    while True:
        finer: Space = levels[-1]
        space = fem.lagrange(model.mesh, order, model.components)
        layout = Nodes(space, model.bodies)
        variation = None
        if model.variation is not None:
            variation = Variation(space, model.bodies.names, model.bodies.cell_body, model.given, model.plane)
        bulk = replace(model.bulk, space=space, variation=variation)
        coarse_fixed = _fixed_on(space, finest, model.components)
        if order == 1:
            coarsest = CoarseLevel(model, layout, bulk, coarse_fixed, [build_interface(layout, name) for name in names])
            levels[-1].interpolation = _interpolation(finer, coarsest)
            return levels, coarsest
        groups = _groups_of(build_interface(layout, name) for name in names)
        levels.append(Level(model, layout, bulk, coarse_fixed, groups))
        levels[-2].interpolation = _interpolation(finer, levels[-1])
        order //= 2


def _groups_of(faces: Iterable[Interface]) -> list[np.ndarray]:
    """Return the nodes that interfaces couple."""
    return [face.plus[:, None] if face.one_sided else np.stack([face.plus, face.minus], axis=1) for face in faces]


def _clusters(groups: list[np.ndarray], count: int) -> list[np.ndarray]:
    """Return connected nodes by the number of them, each of shape (clusters, nodes)."""
    nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(group.ravel() for group in groups)]))
    place = np.zeros(count, dtype=np.int64)
    place[nodes] = np.arange(len(nodes))
    links = [place[group[:, [0, -1]]] for group in groups]
    first, second = np.concatenate([np.zeros((0, 2), dtype=np.int64), *links]).T
    if not len(nodes):
        return []
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(nodes),) * 2)
    label = connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    sizes = np.bincount(label)
    starts = np.r_[0, np.cumsum(sizes)]
    return [nodes[order[starts[np.flatnonzero(sizes == size)][:, None] + np.arange(size)]] for size in np.unique(sizes)]


def _fixed_on(space: Any, finest: Space, components: int) -> np.ndarray:
    """Return the driven degrees of freedom of a coarser space: those of entities whose finest nodes are all driven."""
    fine_space = finest.layout.space
    fine = fine_space.element.basix_element
    coarse = space.element.basix_element
    driven = finest.model.loads.prescribed.reshape(finest.layout.count, -1)
    fine_nodes, coarse_nodes = fine_space.dofmap.list, space.dofmap.list
    index_map = space.dofmap.index_map
    result = np.zeros((index_map.size_local + index_map.num_ghosts, components), dtype=bool)
    for closures, interiors in zip(fine.entity_closure_dofs, coarse.entity_dofs, strict=True):
        for closure, interior in zip(closures, interiors, strict=True):
            if len(interior):
                all_driven = driven[fine_nodes[:, closure]].all(axis=1)
                result[coarse_nodes[:, interior]] |= all_driven[:, None, :]
    return result.ravel()


def _interpolation(fine: Space, coarse: Space) -> Any:
    """Return the interpolation between equations of two levels; collective."""
    made = fem.interpolation(coarse.layout.space, fine.layout.space)
    if coarse.tied is not None:
        made = made.matMult(_copying(coarse))
    rows, columns = made.createVecLeft(), made.createVecRight()
    rows.array[:] = ~fine.fixed[: fine.owned]
    columns.array[:] = ~coarse.fixed[: coarse.owned]
    made.diagonalScale(rows, columns)
    return made


def _copying(coarse: Space) -> Any:
    """Return the map from the equations of kept nodes to all nodes; collective."""
    layout = coarse.layout
    c, numbers = layout.components, layout.space.dofmap.index_map
    node = np.arange(layout.count)
    node[layout.copies] = layout.kept
    column = numbers.local_to_global(node[: layout.owned].astype(np.int32))[:, None] * c + np.arange(c)
    made: Any = fem.PETSc.Mat()
    size = (coarse.owned, numbers.size_global * c)
    start = np.arange(coarse.owned + 1, dtype=fem.PETSc.IntType)
    values = np.ones(coarse.owned)
    made.createAIJ((size, size), csr=(start, column.ravel().astype(fem.PETSc.IntType), values), comm=layout.comm)
    return made
