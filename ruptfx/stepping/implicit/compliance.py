"""Response of linear bodies to loads on their interfaces: the inverse of their stiffness there, as a matrix."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ruptfx.platform import fem, parallel
from ruptfx.stepping.implicit import preconditioners
from ruptfx.stepping.implicit.iterated import Iterated
from ruptfx.stepping.implicit.preconditioners.lu import has_mumps
from ruptfx.stepping.implicit.stored import StoredParts, checksum_of
from ruptfx.stepping.implicit.tangent import Tangent

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.preconditioners import Preconditioner

LOG = logging.getLogger("ruptfx.run")
COLUMNS = 64  # right-hand sides in one solution: fast, with little memory
Finish = Callable[[np.ndarray], np.ndarray]
# A column counts as zero below this part of its largest entry; the full residual decides in the end.
SMALL = 1e-11
LARGEST_STRIP = 0.6  # largest part of all unknowns in a strip; larger ones save little


class Unknowns(Protocol):
    """Loaded points of the bodies, and the displacement components observed there.

    Attributes
    ----------
    points, local : int
        Number of points, and of components at each.
    """

    points: int
    local: int

    @property
    def where(self) -> np.ndarray:
        """Return the coordinates of the points, shape (points, dim) [m]; collective."""
        ...

    def force(self, values: np.ndarray, size: int) -> np.ndarray:
        """Return local nodal forces [N], shape (size,), from loads, shape (points, local)."""
        ...

    def changes(self, fields: Iterable[np.ndarray]) -> np.ndarray:
        """Return changes at the points from displacements of shape (size,): (points, local, fields) [m]; collective."""
        ...


class Jumps:
    """Values at the points of all interfaces, in an order that does not depend on the ranks, known to all ranks.

    Attributes
    ----------
    points : int
        Number of points of all interfaces.
    local : int
        Number of components of a jump.
    """

    def __init__(self, model: System) -> None:
        self._comm = model.comm
        self._faces = {fault.name: fault.interface for fault in model.faults}
        self._places: dict[str, np.ndarray] = {}
        self._runs: dict[str, slice] = {}  # of faults whose points are all on this rank, in order
        self.points, self.local = 0, model.faults[0].interface.frame.shape[1]
        for name, face in self._faces.items():
            self._places[name] = self.points + face.number
            if np.array_equal(face.number, np.arange(face.total)):
                self._runs[name] = slice(self.points, self.points + face.total)
            self.points += face.total

    @property
    def where(self) -> np.ndarray:
        """Return the coordinates of all points, shape (points, dim) [m]; collective."""
        return self.gather({name: face.points for name, face in self._faces.items()})

    @property
    def weight(self) -> np.ndarray:
        """Return the areas of all points, shape (points,) [m], [m2] in 3D; collective."""
        return self.gather({name: face.weight for name, face in self._faces.items()})

    def gather(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return values of all points, shape (points, ...), from those of this rank by fault; collective."""
        tail = next(iter(values.values())).shape[1:]
        if self._comm.size == 1 and len(self._runs) == len(self._faces) == 1:
            return np.array(values[next(iter(self._faces))], dtype=float)
        complete = np.zeros((self.points, *tail))
        for name, face in self._faces.items():
            complete[self._places[name][face.owned]] = values[name][face.owned]
        return complete if self._comm.size == 1 else parallel.total(self._comm, complete)

    def places(self, name: str) -> np.ndarray:
        """Return the indices among all points of the points of one fault on this rank, shape (n,)."""
        return self._places[name]

    def pick(self, whole: np.ndarray, name: str) -> np.ndarray:
        """Return the values of the points of one fault on this rank, shape (n, ...)."""
        return np.asarray(whole[self._runs[name] if name in self._runs else self._places[name]])

    def of(self, displacement: np.ndarray) -> np.ndarray:
        """Return the jump of a displacement at all points, shape (points, local) [m]; collective."""
        return self.gather({name: face.jump(displacement) for name, face in self._faces.items()})

    def changes(self, fields: Iterable[np.ndarray]) -> np.ndarray:
        """Return jumps at all points of displacements, shape (size,) each: (points, local, fields) [m]."""
        entries: dict[str, list[np.ndarray]] = {name: [] for name in self._faces}
        for field in fields:
            for name, face in self._faces.items():
                entries[name].append(face.rate(field))
        return self.gather({name: np.stack(rates, axis=2) for name, rates in entries.items()})

    def force(self, traction: np.ndarray, size: int) -> np.ndarray:
        """Return J' W traction at the local degrees of freedom [N], from tractions of shape (points, local)."""
        force = np.zeros(size)
        for name, face in self._faces.items():
            face.assemble(self.pick(traction, name), force)
        return force

    def taken_apart(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split a nodal force into J' W of tractions, shape (points, local) [Pa], and the rest [N]; collective.

        The rest is zero if the force acts at the interfaces only. Returns tractions and rest.
        """
        entries = {}
        for name, face in self._faces.items():
            nodal = force.reshape(-1, face.frame.shape[2])
            pull = nodal[face.plus] if face.one_sided else 0.5 * (nodal[face.plus] - nodal[face.minus])
            factor = face.jump_factor
            along = np.einsum("ikc,ic->ik", face.frame, pull) / face.weight[:, None]
            entries[name] = np.where(factor > 0, along / np.where(factor > 0, factor, 1.0), 0.0)
        traction = self.gather(entries)
        return traction, force - self.force(traction, len(force))


class Factors:
    """Inverse of the matrix A of bodies, by its factors or, where it is large, by iteration.

    Parameters
    ----------
    model : System
    tangent : Tangent
    fill : callable
        Fills the matrix of the tangent, which is symmetric.
    preconditioner : type of Preconditioner, optional
        That of the tangent; default: that of models without options.

    Attributes
    ----------
    inverse : Decomposed or Iterated
    """

    def __init__(
        self, model: System, tangent: Tangent, fill: Callable[[], object],
        preconditioner: type[Preconditioner] | None = None,
    ) -> None:  # fmt: skip
        self.model = model
        self._owned = model.owned_nodes * model.components
        free = ~model.loads.prescribed
        free.reshape(model.nodes, -1)[model.layout.copies] = False
        self._free = free[: self._owned]
        self._ghosted = fem.dolfinx.fem.Function(model.space)
        preconditioner = preconditioner or preconditioners.choose(model, {})
        self.inverse: Decomposed | Iterated
        if preconditioner.iterative:
            self.inverse = Iterated(model, tangent, preconditioner, fill)
        else:
            fill()
            self.inverse = Decomposed(tangent.matrix)
        self._strip: tuple[Decomposed, np.ndarray] | None = None
        self._stored: StoredParts | None = None

    def solve(self, force: np.ndarray) -> np.ndarray:
        """Return A^-1 force at every local degree of freedom [m], zero for prescribed motion; collective.

        Parameters
        ----------
        force : ndarray, shape (nodes * components,)
            Complete at every local node [N].
        """
        self._ghosted.x.array[: self._owned] = self.inverse.solve(self._on_unknowns(force))
        return self._displacement()

    def _on_unknowns(self, force: np.ndarray) -> np.ndarray:
        """Return the right-hand side of this rank for a nodal force [N]."""
        return self.model.layout.reduce_tied(force)[: self._owned] * self._free

    def _displacement(self) -> np.ndarray:
        """Return the displacement of all local nodes from the unknowns of this rank; collective."""
        self._ghosted.x.scatter_forward()
        displacement: np.ndarray = self._ghosted.x.array.copy()
        self.model.layout.equalise(displacement)
        return displacement

    def near(self, force: np.ndarray) -> np.ndarray | None:
        """Return A^-1 force at the unknowns from a strip around them, None if the strip is too large; collective.

        It is exact at the unknowns of `answers`, zero far away from them, and meaningless in between.
        """
        if self._strip is None:
            return None
        decomposed, dofs = self._strip
        self._ghosted.x.array[:] = 0.0
        self._ghosted.x.array[dofs] = decomposed.solve(self._on_unknowns(force)[dofs])
        return self._displacement()

    def _find_strip(self, where: np.ndarray, reach: float) -> None:
        """Factorise A within reach of some points, if that is much less than all; collective."""
        model, matrix = self.model, self.inverse.given
        away, _ = cKDTree(where).query(model.coordinates[: model.owned_nodes], distance_upper_bound=reach)
        dofs = np.flatnonzero(np.repeat(np.isfinite(away), model.components))
        if parallel.total(model.comm, len(dofs)) <= LARGEST_STRIP * model.total_nodes * model.components:
            made: Any = fem.PETSc.IS()
            rows = (matrix.getOwnershipRange()[0] + dofs).astype(fem.PETSc.IntType)
            chosen = made.createGeneral(rows, comm=model.comm)
            self._strip = Decomposed(matrix.createSubMatrix(chosen, chosen)), dofs

    def solve_each(self, forces: Iterable[np.ndarray], count: int) -> Iterator[np.ndarray]:
        """Yield A^-1 of several forces at a time, which is faster; collective, all ranks must exhaust it."""
        loads = np.zeros((self._owned, count), order="F")
        for column, force in enumerate(forces):
            loads[:, column] = self._on_unknowns(force)
        answers = self.inverse.solve_all(loads)
        for answer in answers.T:
            self._ghosted.x.array[: self._owned] = answer
            yield self._displacement()

    def answers(self, unknowns: Unknowns, strip: bool = False) -> np.ndarray:
        """Return all unknowns under unit loads on each of them, with as few right-hand sides as possible.

        With the limited reach of waves in a step, distant unknowns share a right-hand side. Answers that are iterated
        are kept on disk, so that they are computed once. Collective.

        Parameters
        ----------
        unknowns : Unknowns
        strip : bool
            Also factorise A within reach of them, for `near`.

        Returns
        -------
        ndarray, shape (local, local, points, points)
            Component of the unknown per component of the load.
        """
        distance = cdist(unknowns.where, unknowns.where)
        local, points = unknowns.local, len(distance)
        result = np.zeros((local, local, points, points))
        if isinstance(self.inverse, Iterated):
            self._stored = StoredParts(self._checksum(unknowns), self.model.comm)
        reach = self._reach(unknowns, distance)
        groups = apart(distance, 2 * reach)
        # Without the limited reach everything is felt everywhere, as in equilibrium.
        if strip and reach < distance.max(initial=0.0) and isinstance(self.inverse, Decomposed):
            self._find_strip(unknowns.where, reach)
        for batch in batches(groups, max(1, COLUMNS // local)):
            answered = self._answer(unknowns, batch)
            for column, group in enumerate(batch):
                # Members of a group are so far apart that each unknown depends on the nearest one only.
                nearest = group[np.argmin(distance[:, group], axis=1)]
                result[:, :, np.arange(points), nearest] = np.moveaxis(answered[:, :, column, :], 0, 2)
        if self._stored is not None:
            LOG.info("%s", self._stored.report("bodies: solutions for the matrix of the interfaces"))
        return result

    def _checksum(self, unknowns: Unknowns) -> str:
        """Return the checksum of all that the answers depend on, on every rank; collective.

        The operator of multigrid has no entries: its product with a vector of random numbers stands for them.
        """
        model, matrix, random = self.model, self.inverse.given, np.random.default_rng(0)
        vector, product = matrix.createVecRight(), matrix.createVecLeft()
        vector.array[:] = random.normal(size=self._owned)
        matrix.mult(vector, product)
        loads = random.normal(size=(unknowns.points, unknowns.local))
        arrays = [product.array_r, self._free, model.coordinates, unknowns.force(loads, len(model.mass))]
        own = checksum_of("loads to displacements", [*arrays, unknowns.where])
        return " ".join(model.comm.allgather(own))

    def _reach(self, unknowns: Unknowns, distance: np.ndarray) -> float:
        """Return the distance of influence of a load [m], from those of a few points; collective."""
        sample = np.unique(np.linspace(0, len(distance) - 1, 5).astype(int))
        felt = np.abs(self._answer(unknowns, [np.array([point]) for point in sample])).max(axis=(1, 3))
        return float(np.max(distance[:, sample] * (felt > SMALL * felt.max(axis=0))))

    def _answer(self, unknowns: Unknowns, groups: list[np.ndarray]) -> np.ndarray:
        """Return all unknowns for unit loads on those of each group, one component after another; collective.

        Shape (points, local, groups, local).
        """
        if self._stored is None or len(groups) == 0:
            return self._solved(unknowns, groups)
        shape = unknowns.points, unknowns.local, 1, unknowns.local
        parts = [
            self._stored.part(group.tobytes().hex(), shape, partial(self._solved, unknowns, [group]), self.model.comm)
            for group in groups
        ]
        return np.concatenate(parts, axis=2)

    def _solved(self, unknowns: Unknowns, groups: list[np.ndarray]) -> np.ndarray:
        """Return the answers as `_answer`, by solutions; collective."""
        local = unknowns.local

        def forces() -> Iterator[np.ndarray]:
            for group in groups:
                for k in range(local):
                    unit = np.zeros((unknowns.points, local))
                    unit[group, k] = 1.0
                    yield unknowns.force(unit, len(self.model.mass))

        changes = unknowns.changes(self.solve_each(forces(), len(groups) * local))
        return changes.reshape(unknowns.points, local, len(groups), local)

    def destroy(self) -> None:
        """Free the factors; collective."""
        self.inverse.destroy()
        if self._strip is not None:
            self._strip[0].destroy()


class Decomposed:
    """A factorised symmetric matrix: by MUMPS, or on one rank by PETSc's own LU if MUMPS is missing."""

    def __init__(self, given: fem.PETSc.Mat) -> None:
        self.given = given
        made: Any = fem.PETSc.PC()  # its annotations refuse mpi4py's communicators
        self._pc = made.create(given.comm)
        self._pc.setOperators(given)
        self._pc.setType("cholesky" if has_mumps() else "lu")
        if has_mumps():
            self._pc.setFactorSolverType("mumps")
            self._pc.setFactorSetUpSolverType()
            self._pc.getFactorMatrix().setMumpsIcntl(14, 50)  # room for fill that grows with pivoting
        self._pc.setUp()
        self.matrix = self._pc.getFactorMatrix()
        self._right, self._left = given.createVecLeft(), given.createVecRight()

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution for the entries of this rank; collective."""
        self._right.array[:] = right
        self.matrix.solve(self._right, self._left)
        return np.asarray(self._left.array_r)

    def solve_all(self, right: np.ndarray) -> np.ndarray:
        """Return the solutions for several columns, of the entries of this rank; collective."""
        dense: Any = fem.PETSc.Mat()  # its annotations refuse mpi4py's communicators
        size = (right.shape[0], None), (None, right.shape[1])
        value = dense.createDense(size, array=np.asfortranarray(right), comm=self.given.comm)
        result = value.duplicate()
        self.matrix.matSolve(value, result)
        answer: np.ndarray = result.getDenseArray().copy()
        value.destroy()
        result.destroy()
        return answer

    def destroy(self) -> None:
        """Free the factors; collective."""
        self._pc.destroy()


class Influence:
    """Jumps of interfaces under unit tractions there.

    Attributes
    ----------
    stuck : ndarray, shape (points, local, local)
        k, the stiffness of the interfaces that is part of the matrix of the bodies [Pa/m].
    blocks : ndarray, shape (local, local, points, points)
        S: component of displacement jump per component of traction [m/Pa].
    own : ndarray, shape (points, local, local)
        S of each point on itself.
    weight : ndarray, shape (points,)
        Areas of the points [m], [m2] in 3D.
    farthest : float
        Largest change of jumps in one iteration [m].
    """

    farthest = np.inf

    def __init__(self, stuck: np.ndarray, blocks: np.ndarray, weight: np.ndarray) -> None:
        self.stuck, self.blocks, self.weight = stuck, blocks, weight
        self.own = np.moveaxis(np.diagonal(blocks, axis1=2, axis2=3), 2, 0)

    def jumps_under(self, traction: np.ndarray, rows: slice = slice(None), roughly: bool = False) -> np.ndarray:
        """Return S traction [m], both of shape (points, local), optionally of some points or in single precision."""
        blocks = self._single if roughly else self.blocks
        jumps = np.zeros((traction.shape[1], len(traction[rows])))
        for k, component in enumerate(traction.T):
            reach = reach_of(component != 0)
            jumps += blocks[:, k, rows, reach] @ component[reach].astype(blocks.dtype, copy=False)
        return jumps.T

    @cached_property
    def _single(self) -> np.ndarray:
        """S in single precision."""
        return self.blocks.astype(np.float32)

    def begin(self, force: np.ndarray, small: float) -> tuple[np.ndarray, Finish]:
        """Return the jumps under a force with closed, sticking interfaces, and the back substitution; collective.

        Parameters
        ----------
        force : ndarray, shape (nodes * components,)
            [N]
        small : float
            Norm of the force away from the interfaces up to which the jumps need no back substitution [N].

        Returns
        -------
        ndarray, shape (points, local)
            The jumps, J A^-1 force [m].
        callable
            From q [Pa], shape (points, local), to A^-1 (force - J' W q) [m], shape (nodes * components,); collective.
        """
        raise NotImplementedError


class Compliance(Influence):
    """A^-1 for A = K + c_M M + c_C C + J' W k J, bodies with closed, sticking interfaces; and S = J A^-1 J' W.

    The stiffness k of the interfaces supports bodies without other supports.

    Parameters
    ----------
    model : System
    jumps : Jumps
    tangent : Tangent
        Makes the matrix.
    factors : (float, float)
        c_M [1/s2] and c_C [1/s].
    stuck : dict of str to ndarray, shape (n, local, local)
        k by fault [Pa/m].
    """

    def __init__(
        self, model: System, jumps: Jumps, tangent: Tangent, factors: tuple[float, float], stuck: dict[str, np.ndarray]
    ) -> None:
        self._jumps = jumps
        self._factors = Factors(model, tangent, partial(tangent.update, *factors, stuck, driven=tangent.unit))
        self.solve, self.solve_each = self._factors.solve, self._factors.solve_each
        super().__init__(jumps.gather(stuck), self._factors.answers(jumps, strip=True), jumps.weight)

    def begin(self, force: np.ndarray, small: float) -> tuple[np.ndarray, Finish]:
        # In quasi-static steps with steady loading the unbalanced forces are at the interfaces only.
        traction, remainder = self._jumps.taken_apart(force)
        solve, pull = self.solve, self._jumps.force
        if norm(self._factors.model, remainder) <= small:
            return self.jumps_under(traction), lambda q: -solve(pull(q, len(force)) - force)
        near = self._factors.near(force)
        if near is not None:
            return self._jumps.changes([near])[:, :, 0], lambda q: -solve(pull(q, len(force)) - force)
        free = solve(force)
        return self._jumps.changes([free])[:, :, 0], lambda q: free - solve(pull(q, len(force)))

    def destroy(self) -> None:
        """Free the factors; collective."""
        self._factors.destroy()


def reach_of(flags: np.ndarray) -> slice:
    """Return a slice from the first to the last true entry, as sliding points are mostly contiguous."""
    set_ = np.flatnonzero(flags)
    return slice(set_[0], set_[-1] + 1) if len(set_) else slice(0, 0)


def norm(model: System, force: np.ndarray) -> float:
    """Return the norm over all nodes [N]; collective."""
    return float(np.sqrt(parallel.total(model.comm, model.layout.owned_dot(force, force))))


def apart(distance: np.ndarray, least: float) -> list[np.ndarray]:
    """Return groups of points with distances among each other larger than `least`, each point in one of them.

    Parameters
    ----------
    distance : ndarray, shape (points, points)
        [m]
    """
    groups: list[list[int]] = []
    if least >= distance.max(initial=0.0):
        return [np.array([point]) for point in range(len(distance))]
    for point in range(len(distance)):
        fitting = (group for group in groups if distance[point, group].min() > least)
        group = next(fitting, None)
        if group is None:
            groups.append([point])
        else:
            group.append(point)
    return [np.array(group) for group in groups]


def batches(groups: list[np.ndarray], size: int) -> Iterator[list[np.ndarray]]:
    """Yield groups, a given number at a time."""
    for start in range(0, len(groups), size):
        yield groups[start : start + size]
