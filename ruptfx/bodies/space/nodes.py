"""Nodes of a model: nodes shared with other ranks, sums over them, and a partition-independent order."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.space.bodies import Bodies
from ruptfx.bodies.space.closest import closest
from ruptfx.platform import distributed_rows, fem, parallel


def largest_extent(points: np.ndarray) -> float:
    """Return the largest extent of points along an axis [m].

    One axis after the other, which takes a thirtieth of the time of all together.
    """
    return float(max(np.ptp(column) for column in points.T)) if len(points) else 0.0


class Nodes:
    """Nodes of a blocked Lagrange space over the ranks; ghosts are local nodes, too, after the owned ones.

    Attributes
    ----------
    count, owned, total : int
        Numbers of local nodes, of nodes owned by this rank, and of nodes of all ranks.
    components : int
    broken : bool
        True if every cell has its own nodes.
    coordinates : ndarray, shape (count, dim)
        [m].
    kept, copies : ndarray of int, shape (n,)
        Pairs of tied local nodes, which move alike; a rank with one of them has both.

    Raises
    ------
    RuptfxError
        On all ranks, if a node would be tied to two others.
    """

    def __init__(self, space: fem.dolfinx.fem.FunctionSpace, bodies: Bodies) -> None:
        self.space, self.bodies, self.comm = space, bodies, space.mesh.comm
        index_map = space.dofmap.index_map
        self.components = space.dofmap.index_map_bs
        self.broken = bool(space.element.basix_element.discontinuous)
        self.owned = index_map.size_local
        self.count = index_map.size_local + index_map.num_ghosts
        self.total = index_map.size_global
        self._exchange = fem.dolfinx.fem.Function(space)
        self.coordinates = self._shared_coordinates()
        self.kept, self.copies = self._tied()

    def _shared_coordinates(self) -> np.ndarray:
        """Return the coordinates of all local nodes [m], at ghost nodes those of their owners; collective.

        The last digits of a tabulated coordinate depend on the cell that it was computed from. Coefficients that
        follow from coordinates must be bitwise identical on all ranks with a node, else its velocities drift apart.
        """
        shared_coordinates = self.space.tabulate_dof_coordinates()[:, : self.space.mesh.geometry.dim].copy()
        for column in shared_coordinates.T:
            values = np.repeat(column, self.components)
            self.take_from_owners(values)
            column[:] = values[:: self.components]
        return shared_coordinates

    def _tied(self) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs of nodes of tied edges; collective."""
        pairs, error = [np.zeros((2, 0), dtype=np.int64)], None
        extent = largest_extent(self.coordinates)
        for tie in self.bodies.ties:
            first, second = (
                fem.dolfinx.fem.locate_dofs_topological(
                    self.space, self.space.mesh.topology.dim - 1, self.bodies.facets.find(self.bodies.tags[edge])
                )
                for edge in (tie.first, tie.second)
            )
            pairs.append(np.stack([first, first]).astype(np.int64))
            if len(first) or len(second):
                near = closest(self.coordinates[first] + tie.shift, self.coordinates[second])
                if len(first) != len(second) or np.any(near[0] > 1e-8 * extent):
                    error = RuptfxError(f"{tie.key}: this rank has nodes of one edge only (a fault of the partition)")
                    break
                pairs[-1][1] = second[near[1]]
        kept, copies = np.concatenate(pairs, axis=1)
        node, times = np.unique(np.concatenate([kept, copies]), return_counts=True)
        if error is None and np.any(times > 1):
            x = ", ".join(f"{value:.6g}" for value in self.coordinates[node[np.argmax(times)]])
            keys = ", ".join(tie.key for tie in self.bodies.ties)
            error = RuptfxError(
                f"{keys}: the node at ({x}) m is tied to two others. Edges of one direction can be tied, and an "
                "interface that ends at one of them must go on at the other"
            )
        parallel.raise_on_all(self.comm, error)
        self._pairs = pairs[1:]
        return kept, copies

    def ties_of(self, node: int) -> str:
        """Return the keys of the boundaries that tie a local node."""
        return ", ".join(tie.key for tie, pair in zip(self.bodies.ties, self._pairs, strict=True) if node in pair)

    def sum_tied(self, vector: np.ndarray) -> None:
        """Replace the values of tied nodes by their sum, in place."""
        rows = vector.reshape(self.count, -1)
        rows[self.kept] += rows[self.copies]
        rows[self.copies] = rows[self.kept]

    def equalise(self, vector: np.ndarray) -> None:
        """Copy the values of kept nodes to their copies, in place."""
        rows = vector.reshape(self.count, -1)
        rows[self.copies] = rows[self.kept]

    def reduce_tied(self, vector: np.ndarray) -> np.ndarray:
        """Return nodal forces on the unknowns, same shape: the sum at the kept node of a tie, zero at its copy."""
        if not len(self.copies):
            return vector
        reduced = vector.copy()
        rows = reduced.reshape(self.count, -1)
        rows[self.kept] += rows[self.copies]
        rows[self.copies] = 0.0
        return reduced

    @cached_property
    def once(self) -> np.ndarray:
        """True for every node owned by this rank, of tied nodes for the kept one."""
        once = np.arange(self.count) < self.owned
        once[self.copies] = False
        return once

    def sum_shared(self, vector: np.ndarray) -> None:
        """Add the contributions of all ranks at shared nodes, in place; every rank ends with the sum."""
        if self.comm.size > 1:
            x = self._exchange.x
            x.array[:] = vector
            x.scatter_reverse(fem.dolfinx.la.InsertMode.add)
            x.scatter_forward()
            vector[:] = x.array

    def take_from_owners(self, vector: np.ndarray) -> None:
        """Replace values at ghost nodes by those of their owners, in place; collective."""
        if self.comm.size > 1:
            x = self._exchange.x
            x.array[:] = vector
            x.scatter_forward()
            vector[:] = x.array

    @cached_property
    def touches(self) -> np.ndarray:
        """True where a local node belongs to a body, shape (bodies, nodes); several are true at a weld; collective."""
        dofs, c = self.space.dofmap.list, self.components
        touches = np.zeros((len(self.bodies.names), self.count), dtype=bool)
        for number, row in enumerate(touches):
            marked = np.zeros(self.count * c)
            marked.reshape(-1, c)[dofs[self.bodies.cell_body[: len(dofs)] == number]] = 1
            self.sum_shared(marked)
            row[:] = marked[::c] > 0
        return touches

    @property
    def body(self) -> np.ndarray:
        """Index of the first body of every local node; nodes of welds belong to others, too (`touches`); collective."""
        return self.touches.argmax(axis=0)

    @cached_property
    def welded(self) -> np.ndarray:
        """Label of every body, the same for bodies that are welded, directly or through others; collective."""
        shared = parallel.total(self.comm, (self.touches.astype(float) @ self.touches.T).ravel())
        from scipy.sparse.csgraph import connected_components  # cases are read without SciPy

        return np.asarray(connected_components(shared.reshape(len(self.touches), -1), directed=False)[1])

    @cached_property
    def numbering(self) -> np.ndarray:
        """Global index of every local node in an order that does not depend on the partition; collective.

        The order is by body, y and x, or, if every cell has its own nodes, by cells and corners of the input.
        """
        if self.broken:
            number = np.empty(self.count, dtype=np.int64)
            cells = np.asarray(self.space.mesh.topology.original_cell_index, dtype=np.int64)
            dofs = self.space.dofmap.list
            number[dofs] = dofs.shape[1] * cells[: len(dofs), None] + np.arange(dofs.shape[1])
            return number
        owned, x = slice(0, self.owned), self.coordinates
        ends = [[parallel.largest(self.comm, (sign * axis).max(initial=-np.inf)) for axis in x.T] for sign in (1, -1)]
        extent = max(high + low for high, low in zip(*ends, strict=True))
        places = np.zeros((self.count, self.components))
        places[owned] = parallel.places(self.comm, np.column_stack([np.round(x[owned] / extent, 9), self.body[owned]]))[
            :, None
        ]
        function = self._exchange.x  # a double holds any whole number up to 9e15
        function.array[:] = places.ravel()
        function.scatter_forward()
        return function.array.reshape(self.count, -1)[:, 0].astype(np.int64)

    @cached_property
    def rows(self) -> distributed_rows.RowDistribution:
        """Distribution of the rows of owned nodes in the order of `numbering`; collective."""
        return distributed_rows.RowDistribution(self.comm, self.numbering[: self.owned], self.total)

    def collect(self, field: np.ndarray) -> np.ndarray:
        """Return the block of this rank of a nodal field in the order of `numbering`; collective.

        Parameters
        ----------
        field : ndarray, shape (count * columns,)

        Returns
        -------
        ndarray, shape (places, columns)
        """
        return self.rows.collect(field.reshape(self.count, -1)[: self.owned])

    def spread(self, block: np.ndarray) -> np.ndarray:
        """Return the nodal field of a block, ghosts included, shape (count * columns,); the inverse of `collect`."""
        return distributed_rows.RowDistribution(self.comm, self.numbering, self.total).spread(block).ravel()

    @cached_property
    def shared(self) -> np.ndarray:
        """True for every local node that exists on another rank, too."""
        if self.comm.size == 1:
            return np.zeros(self.count, dtype=bool)
        flag = self._exchange.x
        flag.array[:] = 0
        flag.array[self.owned * self.components :] = 1
        flag.scatter_reverse(fem.dolfinx.la.InsertMode.add)
        flag.scatter_forward()
        return flag.array.reshape(self.count, -1)[:, 0] > 0

    def owned_dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Return the scalar product over the degrees of freedom owned by this rank.

        Tied nodes count their own shares.
        """
        owned = self.owned * self.components
        return float(a[:owned] @ b[:owned])
