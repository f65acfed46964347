"""Stiffness of linear bodies at the nodes of their interfaces, for any mortar pairing between them.

With finite sliding, jumps and tractions change with the pairing: [u] = J_s v, forces J_s' W t, with v the
displacement of the nodes of all interfaces, which are fixed to their bodies. The bodies enter by
their stiffness D with all inner nodes condensed,

    D = (G A^-1 G')^-1 - h,    A = K + c_M M + c_C C + G' h G,

with G the restriction to the nodes of the interfaces. Springs h to the ground, as stiff as the nodes themselves, make A
regular for unsupported bodies, and the small matrix well conditioned, so that subtracting them costs hardly
more than the last digit. D depends on the length of the step only. For every pairing, J_s' W k J_s of interfaces that
are closed and stuck is added, and the inverse of the sum gives jumps from tractions.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import inv
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import bsr_array, coo_array, csr_array

from ruptfx import RuptfxError
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.platform import parallel
from ruptfx.stepping.implicit.compliance import Factors, Finish, Influence, Jumps, norm

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.tangent import Tangent


def count_components(model: System) -> int:
    """Return how many components of surfaces with meshes of their own steps solve the bodies for; collective."""
    if not any(fault.slides for fault in model.faults):
        return 0
    return int(parallel.total(model.comm, len(_owned_nodes(model)))) * model.components


def _owned_nodes(model: System) -> np.ndarray:
    """Return the local nodes of interfaces that this rank owns."""
    nodes = np.unique(np.concatenate([fault.interface.nodes for fault in model.faults]))
    return nodes[nodes < model.owned_nodes]


class Surfaces:
    """Displacements and forces of the nodes of all interfaces, in an order that all ranks know.

    Attributes
    ----------
    points, local : int
        Number of nodes, and of components of a displacement.
    where : ndarray, shape (points, dim)
        Coordinates [m].
    farthest : float
        Length of the facets of sliding interfaces [m].
    """

    def __init__(self, model: System, jumps: Jumps) -> None:
        self._model, self._jumps, self.local = model, jumps, model.components
        owned = _owned_nodes(model)
        of_all = parallel.share_rows(model.comm, self._global(owned))
        self._numbers, self.points = np.sort(of_all), len(of_all)
        self._nodes = np.unique(np.concatenate([fault.interface.nodes for fault in model.faults]))
        self._places = self._place(self._nodes)
        self.where = self.gather(model.coordinates)
        # Bodies that move by more than a facet at once have no support.
        faces = [fault.interface for fault in model.faults]
        facets = [face.near for face in faces if isinstance(face, SlidingInterface)]
        self.farthest = parallel.largest(model.comm, max(facets, default=0.0))

    def _global(self, nodes: np.ndarray) -> np.ndarray:
        index_map = self._model.space.dofmap.index_map
        return np.asarray(index_map.local_to_global(nodes.astype(np.int32)), dtype=np.int64)

    def _place(self, nodes: np.ndarray) -> np.ndarray:
        """Return the indices of local nodes of interfaces among those of all ranks."""
        return np.searchsorted(self._numbers, self._global(nodes.ravel())).reshape(nodes.shape)

    def gather(self, nodal: np.ndarray) -> np.ndarray:
        """Return values of all nodes of interfaces, shape (points, ...), from values at all local nodes; collective."""
        return self._gathered(nodal[self._nodes])

    def _gathered(self, values: np.ndarray) -> np.ndarray:
        complete, owned = np.zeros((self.points, *values.shape[1:])), self._nodes < self._model.owned_nodes
        complete[self._places[owned]] = values[owned]
        return complete if self._model.comm.size == 1 else parallel.total(self._model.comm, complete)

    def force(self, values: np.ndarray, size: int) -> np.ndarray:
        """Return local nodal forces [N], shape (size,), from those of interface nodes, shape (points, local)."""
        force = np.zeros((size // self.local, self.local))
        force[self._nodes] = values[self._places]
        return force.ravel()

    def changes(self, fields: Iterable[np.ndarray]) -> np.ndarray:
        """Return values at the nodes from displacements of shape (size,): (points, local, fields) [m]; collective."""
        return self._gathered(np.stack([field.reshape(-1, self.local)[self._nodes] for field in fields], axis=2))

    def operator(self) -> csr_array:
        """Return J_s for the present pairing, shape (all points * local, points * local); collective."""
        rows = []
        for fault in self._model.faults:
            face = fault.interface
            nodes, blocks = face.stencil()
            point = self._jumps.places(fault.name)[:, None, None, None] * self._jumps.local
            row = point + np.arange(self._jumps.local)[:, None]
            column = self._place(nodes)[:, :, None, None] * self.local + np.arange(self.local)
            entries = np.broadcast_arrays(row, column, blocks)
            chosen = face.owned[:, None, None, None] & (blocks != 0)
            rows.append(np.column_stack([part[chosen].astype(float) for part in entries]))
        row, column, values = parallel.share_rows(self._model.comm, np.concatenate(rows)).T
        shape = self._jumps.points * self._jumps.local, self.points * self.local
        return csr_array(coo_array((values, (row.astype(int), column.astype(int))), shape=shape))


class SurfaceStiffness:
    """Stiffness D of the bodies at the nodes of all interfaces, with all other nodes in equilibrium.

    Parameters
    ----------
    model : System
    surfaces : Surfaces
    tangent : Tangent
        Makes the matrix.
    factors : (float, float)
        c_M [1/s2] and c_C [1/s].

    Attributes
    ----------
    free : ndarray of bool, shape (points * local,)
        True for degrees of freedom without prescribed motion.
    stiffness : ndarray, shape (free, free)
        D [N/m].
    springs : ndarray, shape (free,)
        h [N/m].
    """

    def __init__(self, model: System, surfaces: Surfaces, tangent: Tangent, factors: tuple[float, float]) -> None:
        self.surfaces, nodal = surfaces, (-1, surfaces.local)
        own = tangent.diagonal + factors[0] * model.mass
        self.free = surfaces.gather(model.loads.prescribed.reshape(nodal)).ravel() == 0
        # Springs at the nodes of interfaces, which D has not: factors exist also where only interfaces support a body.
        springs = surfaces.gather(own.reshape(nodal))
        held = surfaces.force(springs, len(own))
        fill = partial(tangent.update, *factors, {}, driven=tangent.unit, springs=held)
        self.factors = Factors(model, tangent, fill)
        blocks = self.factors.answers(surfaces)
        free, size = self.free, surfaces.points * surfaces.local
        compliance = blocks.transpose(2, 0, 3, 1).reshape(size, size)[np.ix_(free, free)]
        self.springs = springs.ravel()[free]
        # The mean with its transpose, because the responses are symmetric up to the rounding of the solver only.
        self.stiffness = inv(0.5 * (compliance + compliance.T), overwrite_a=True, check_finite=False)
        self.stiffness[np.diag_indices_from(self.stiffness)] -= self.springs

    def destroy(self) -> None:
        """Free the factors; collective."""
        self.factors.destroy()


class PairedCompliance(Influence):
    """Jumps under unit tractions with the present pairing of the interfaces.

    It is `Compliance` with S = J_s (D + J_s' W k J_s)^-1 J_s' W.

    Parameters
    ----------
    bodies : SurfaceStiffness
    jumps : Jumps
    stuck : dict of str to ndarray, shape (n, local, local)
        k by fault [Pa/m].

    Raises
    ------
    RuptfxError
        On all ranks: bodies without any support, closed interfaces included.
    """

    def __init__(self, bodies: SurfaceStiffness, jumps: Jumps, stuck: dict[str, np.ndarray]) -> None:
        self._bodies, weight = bodies, jumps.weight
        self._jump = bodies.surfaces.operator()[:, bodies.free]
        k, each = jumps.gather(stuck), np.arange(jumps.points + 1)
        self._closed = self._jump.T @ bsr_array((weight[:, None, None] * k, each[:-1], each)) @ self._jump
        self._compliance = _inverse(bodies.stiffness + self._closed.toarray())
        local, points = jumps.local, jumps.points
        answers = self._jump @ (self._jump @ self._compliance).T  # symmetric
        blocks = answers.reshape(points, local, points, local).transpose(1, 3, 0, 2) * weight
        self.farthest = bodies.surfaces.farthest
        super().__init__(k, np.ascontiguousarray(blocks), weight)

    def begin(self, force: np.ndarray, small: float) -> tuple[np.ndarray, Finish]:
        bodies, surfaces = self._bodies, self._bodies.surfaces
        there = surfaces.gather(force.reshape(-1, surfaces.local))
        beside = force - surfaces.force(there, len(force))
        begun, moved, acting = force, np.zeros_like(force), there.ravel()[bodies.free]
        # Forces at other nodes act on the interfaces by their displacement; without such forces one solution is saved.
        if norm(bodies.factors.model, beside) > small:
            begun, moved = np.zeros_like(force), bodies.factors.solve(force)
            v = surfaces.gather(moved.reshape(-1, surfaces.local)).ravel()[bodies.free]
            acting = bodies.stiffness @ v + bodies.springs * v  # the force with that displacement of the nodes

        def finish(q: np.ndarray) -> np.ndarray:
            pull = self._jump.T @ (self.weight[:, None] * q).ravel()
            v = self._compliance @ (acting - pull)
            values = np.zeros(len(bodies.free))
            values[bodies.free] = bodies.springs * v - self._closed @ v - pull
            rest = surfaces.force(values.reshape(-1, surfaces.local), len(force))
            return np.asarray(moved + bodies.factors.solve(begun + rest))

        return (self._jump @ (self._compliance @ acting)).reshape(len(self.weight), -1), finish


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a symmetric, positive definite matrix, which is overwritten."""
    factor, failed = dpotrf(matrix.T, lower=0, overwrite_a=1)
    if not failed:
        factor, failed = dpotri(factor, lower=0, overwrite_c=1)
    if failed:
        raise RuptfxError("bodies that nothing holds, not even their interfaces if these were closed")
    upper = np.triu(factor)
    upper += np.triu(factor, 1).T
    return upper
