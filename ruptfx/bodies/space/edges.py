"""A named edge of the bodies, for boundaries: its nodes, nodal forces, dashpots and springs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS
from ruptfx.input.schema import CaseError
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.platform.fem import Expr

MOST_COUPLING = 0.01  # largest off-diagonal part of the impedance, over its trace
Limits = Sequence[Sequence[float] | None]


class Edge:
    """An edge of a model.

    Parameters
    ----------
    name : str
        ``"upper.left"``.
    key : str
        Of the case, for messages.

    Raises
    ------
    RuptfxError
        No such edge.
    """

    def __init__(self, model: Discretisation, name: str, key: str) -> None:
        self.model, self.name, self._key = model, name, key
        self.tag = model.bodies.tag(name, key)

    @cached_property
    def facets(self) -> np.ndarray:
        """Local facets, shape (facets,)."""
        return self.model.bodies.facets.find(self.tag)

    @cached_property
    def nodes(self) -> np.ndarray:
        """Local nodes, shape (nodes of the edge,)."""
        if self.model.layout.broken:
            return self._corners()
        return fem.dolfinx.fem.locate_dofs_topological(self.model.space, self.model.mesh.topology.dim - 1, self.facets)

    def _corners(self) -> np.ndarray:
        """Return the local nodes if cells have separate nodes, sent by the owners of the cells; collective."""
        model, mesh, side = self.model, self.model.mesh, self.model.mesh.topology.dim - 1
        mesh.topology.create_connectivity(side, 0)
        mesh.topology.create_connectivity(side + 1, 0)
        of_facets, of_cells = (mesh.topology.connectivity(dim, 0) for dim in (side, side + 1))
        marked = np.zeros((model.nodes, model.components))
        for facet, cell in zip(self.facets, self._cells, strict=True):
            corners = np.isin(of_cells.links(cell), of_facets.links(facet))
            marked[model.space.dofmap.list[cell][corners]] = 1
        return np.flatnonzero(fem.from_owners(model.space, marked)[:, 0] > 0)

    def dofs(self, component: str, limits: Limits = ()) -> np.ndarray:
        """Return local degrees of freedom of one component; `limits` along each axis restrict the part [m]."""
        nodes, coordinates = self.nodes, self.model.coordinates
        x = coordinates[nodes]
        slack = 1e-9 * np.ptp(coordinates, axis=0).max(initial=0)
        for axis, bounds in enumerate(limits):
            if bounds is not None:
                keep = (x[:, axis] >= bounds[0] - slack) & (x[:, axis] <= bounds[1] + slack)
                nodes, x = nodes[keep], x[keep]
        number = 0 if self.model.components == 1 else "xyz".index(component)
        return nodes * self.model.components + number

    def along(self) -> np.ndarray:
        """Return x of every local node if the edge is longer than high, else y [m]; collective."""
        x, comm = self.model.coordinates[self.nodes], self.model.comm
        extent = [
            parallel.largest(comm, column.max(initial=-np.inf)) + parallel.largest(comm, -column.min(initial=np.inf))
            for column in x.T[:2]
        ]
        return self.model.coordinates[:, int(extent[1] > extent[0])]

    def force(self, traction: Sequence[float], limits: Limits = ()) -> np.ndarray:
        """Return the nodal force of a constant traction [Pa] on an edge [N]; `limits` restrict the loaded part."""
        test = self._loaded_cells(limits) * fem.ufl.TestFunction(self.model.space)
        scalar = self.model.components == 1
        density = traction[0] * test if scalar else fem.ufl.inner(fem.ufl.as_vector(list(traction)), test)
        return fem.assemble_summed(self.model.space, self.model.around(density) * self.model.edge_measure(self.tag))

    def integral(self, density: Callable[[list[Expr], Expr], Expr], limits: Limits = ()) -> np.ndarray:
        """Return the edge integral of a linear form of the test function, at every local degree of freedom.

        Parameters
        ----------
        density : callable, (components of the test function, outward normal) -> UFL expression
        limits : sequence of pairs, optional
            Along each axis, limits of the middle of the sides that count [m].
        """
        test = fem.ufl.TestFunction(self.model.space)
        tests = [test] if self.model.components == 1 else list(test)
        expression = density(tests, fem.ufl.FacetNormal(self.model.mesh))
        if any(limits):
            expression *= self._loaded_cells(limits)
        return fem.assemble_summed(self.model.space, self.model.around(expression) * self.model.edge_measure(self.tag))

    def _loaded_cells(self, limits: Limits) -> fem.dolfinx.fem.Function:
        """Return 1 in cells with a side of the edge whose middle is within the limits, 0 in others."""
        mesh, side = self.model.mesh, self.model.mesh.topology.dim - 1
        loaded = fem.dolfinx.fem.Function(fem.dolfinx.fem.functionspace(mesh, ("DG", 0)))
        middle = fem.dolfinx.mesh.compute_midpoints(mesh, side, self.facets)
        inside = np.ones(len(self.facets), dtype=bool)
        for axis, bounds in enumerate(limits):
            if bounds is not None:
                inside &= (middle[:, axis] > bounds[0]) & (middle[:, axis] < bounds[1])
        loaded.x.array[loaded.function_space.dofmap.list[self._cells[inside], 0]] = 1
        return loaded

    @cached_property
    def _cells(self) -> np.ndarray:
        """Cell of every facet."""
        mesh, side = self.model.mesh, self.model.mesh.topology.dim - 1
        mesh.topology.create_connectivity(side, side + 1)
        cells = mesh.topology.connectivity(side, side + 1)
        return np.array([cells.links(facet)[0] for facet in self.facets], dtype=np.int64)

    @cached_property
    def bodies(self) -> np.ndarray:
        """Index of the body of every facet."""
        return self.model.bodies.cell_body[self._cells]

    def dashpot(self, oblique: bool = False) -> np.ndarray:
        """Return the Lysmer dashpot of every degree of freedom [N s/m]: the diagonal of the impedance; collective.

        For an isotropic body rho c_p along the normal and rho c_s across, if the edge is along an axis.

        Parameters
        ----------
        oblique : bool
            Accept an impedance that is not a diagonal matrix, without the entries beside its diagonal.

        Raises
        ------
        CaseError
            If the impedance is not a diagonal matrix, unless `oblique`.
        """
        model = self.model
        coupling = 0.0 if oblique else self.coupling()
        if coupling > MOST_COUPLING:
            raise CaseError(
                f"{self._key} = '{self.name}': dashpots along x and y would send back {coupling:.1%} "
                f"of a wave at normal incidence, at most {MOST_COUPLING:.0%} is allowed; turn the edge, and the axes "
                "of an anisotropic material, along an axis, or take kind = 'sponge', at any angle"
            )
        dim = model.mesh.geometry.dim
        diagonal = np.array(
            [
                np.diagonal(material.impedance(np.eye(dim), model.plane), axis1=1, axis2=2)
                for material in model.materials
            ]
        )  # by body, axis of the normal and component

        def impedance(axis: int, i: int) -> Expr:
            varying = model.variation
            if varying is None:
                return model.by_cell(diagonal[model.bodies.cell_body, axis, i])
            return varying.function(varying.evaluate(
                lambda material, body: varying.impedance(material, body, axis == i, diagonal[body, axis, i])
            ))  # fmt: skip

        return self.integral(lambda tests, n: sum(
            impedance(axis, i) * n[axis] ** 2 * tests[i] for axis in range(dim) for i in range(model.components)
        ))  # fmt: skip

    def normals(self) -> np.ndarray:
        """Return the unit normal of every facet, of either sign, shape (facets, dim)."""
        mesh, side = self.model.mesh, self.model.mesh.topology.dim - 1
        count = len(FACETS[mesh.basix_cell().name][0])
        x = mesh.geometry.x[fem.corners_of_facets(mesh, self.facets, count)]
        along = x[:, 1:] - x[:, :1]
        normal = np.cross(along[:, 0], along[:, 1] if side == 2 else [0.0, 0.0, 1.0])[:, : side + 1]
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def coupling(self) -> float:
        """Return the off-diagonal part of the impedance over its trace, the largest of all facets; collective.

        0 if dashpots are exact; else about the reflected part of a plane wave at normal incidence.
        """
        model, normal = self.model, self.normals()
        worst, error = 0.0, None
        for index, material in enumerate(model.materials):
            n = normal[self.bodies == index]
            try:
                exact, axes = (material.impedance(item, model.plane) for item in (n, np.eye(n.shape[1])))
            except RuptfxError as caught:
                error = caught
                break
            used = np.einsum("ia,acd,cd->icd", n**2, axes, np.eye(model.components))
            left_out = np.abs(exact - used).max(axis=(1, 2)) / np.trace(exact, axis1=1, axis2=2)
            worst = max(worst, left_out.max(initial=0.0))
        parallel.raise_on_all(model.comm, error)
        return parallel.largest(model.comm, worst)
