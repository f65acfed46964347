"""Bodies that repeat along strike: their section, with three components of displacement for every wavenumber.

With displacements u_x, u_y = U, V cos kz and u_z = W sin kz the strains are

    xx = U_x,  yy = V_y,  zz = k W,  2 xy = U_y + V_x   (times cos kz)
    2 xz = W_x - k U,  2 yz = W_y - k V                 (times sin kz)

so that every wavenumber k is a symmetric real problem on the 2D mesh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_matrix

from ruptfx.bodies.boundaries.loading import Loads
from ruptfx.bodies.space.bodies import distribute
from ruptfx.bodies.space.closest import closest
from ruptfx.bodies.space.discretisation import Discretisation
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.interface import Interface, build_interface
from ruptfx.laws.materials.stiffness import linear_stiffness
from ruptfx.platform import fem

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries import Boundary
    from ruptfx.bodies.meshes import MeshSource
    from ruptfx.laws.materials import Material

COUPLED = 1e-9  # stiffness between strains that are even and odd in z, over the largest, above which z is no axis
EVEN, ODD = (0, 1, 2, 3), (4, 5)  # strains xx, yy, zz, xy and yz, xz


class Section(Discretisation):
    """Bodies on a 2D mesh with three components of displacement, all of them on this rank.

    Parameters
    ----------
    mesh : MeshSource
    materials : mapping of str to Material
    order : int
    boundaries : sequence of Boundary
        Driven edges, elastic supports and ties.

    Attributes
    ----------
    mesh_table : MeshSource
    faces : dict of str to Interface
        With the local directions normal, z (along strike) and tangent of the section.
    loads : Loads

    Raises
    ------
    CaseError
        Loads other than driven edges, materials without z as an axis, interfaces without matching sides.
    """

    def __init__(
        self, mesh: MeshSource, materials: Mapping[str, Material], order: int, boundaries: Sequence[Boundary]
    ) -> None:
        keys = {f"boundaries.{number}": boundary.tied_edges for number, boundary in enumerate(boundaries)}
        tied = {key: edges for key, edges in keys.items() if edges is not None}
        comm = fem.MPI.COMM_SELF
        self.mesh_table = mesh
        super().__init__(comm, distribute(comm, mesh, tied), materials, "strain", order, broken=False)
        self.faces = {name: _with_strike(build_interface(self.layout, name)) for name in self.bodies.interfaces}
        self.loads = Loads(self, boundaries)
        if self.loads.loading:
            number = self.loads.loading[0]
            raise CaseError(
                f"boundaries.{number}.kind = '{boundaries[number].kind()}': sections that repeat along strike are "
                "loaded by driven edges (and held by springs); give the stress of a pressure as initial_stress"
            )
        self._require_axis()

    def _count_components(self) -> int:
        return 3

    def _require_axis(self) -> None:
        for name, material in zip(self.bodies.names, self.materials, strict=True):
            if material.isotropic:
                continue
            stiffness = linear_stiffness(material, "solid")
            strains = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]
            table = np.array([[stiffness[(*row, *column)] for column in strains] for row in strains])
            coupling = np.abs(table[np.ix_(EVEN, ODD)]).max() / np.abs(table).max()
            if coupling > COUPLED:
                raise CaseError(
                    f"materials.{name}: z is no axis of it (stiffness between xx, yy, zz, xy and yz, xz is "
                    f"{coupling:.2g} of the largest), which mesh.along_strike needs; turn its axes about z only"
                )

    def strain_measure(self) -> fem.ufl.Measure:
        """Return the measure of the strain energy: exact on straight elements.

        With the quadrature of the mass errors of the closed forms are 2.5 times as large at order 2.
        """
        return self.measure()(metadata={"quadrature_degree": 2 * self.order})

    @cached_property
    def _compiled(self) -> tuple[Any, Any]:
        """Second derivative of the strain energy, and its constant: the wavenumber [1/m]."""
        ufl = fem.ufl
        k = fem.dolfinx.fem.Constant(self.mesh, 0.0)
        field = fem.dolfinx.fem.Function(self.space)
        u, v, w = field
        xz, yz, xy = 0.5 * (w.dx(0) - k * u), 0.5 * (w.dx(1) - k * v), 0.5 * (u.dx(1) + v.dx(0))
        strain = ufl.as_matrix([[u.dx(0), xy, xz], [xy, v.dx(1), yz], [xz, yz, k * w]])
        dx = self.strain_measure()
        stored = sum(each.energy_density(strain, "solid") * dx(i) for i, each in enumerate(self.materials_in_forms()))
        trial, test = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        return fem.form(ufl.derivative(ufl.derivative(stored, field, test), field, trial)), k

    @cached_property
    def powers(self) -> tuple[csr_matrix, csr_matrix, csr_matrix]:
        """Matrices of k^0, k^1 and k^2 in the stiffness of the bodies and their supports."""
        form, wavenumber = self._compiled
        unit = 1 / np.sqrt(np.abs(np.ptp(self.coordinates, axis=0)).prod() / max(self.nodes, 1))  # about one per node

        def at(value: float) -> csr_matrix:
            wavenumber.value = value
            return fem.local_matrix(form)

        none, plus, minus = at(0.0), at(unit), at(-unit)
        supported = none + self._supports()
        return supported, (plus - minus) / (2 * unit), (0.5 * (plus + minus) - none) / unit**2

    def _supports(self) -> csr_matrix:
        rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
        for support in self.loads.supports:
            dofs = support.nodes[:, None] * 3 + np.arange(3)
            rows.append(np.repeat(dofs, 3, axis=1).ravel())
            columns.append(np.tile(dofs, (1, 3)).ravel())
            values.append(support.stiffness.ravel())
        size = 3 * self.nodes
        return csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (size, size))

    @cached_property
    def unknowns(self) -> csr_matrix:
        """Map from the unknowns to all degrees of freedom: copies of tied nodes follow, driven ones are zero."""
        node = np.arange(self.nodes)
        node[self.layout.copies] = self.layout.kept
        source = (node[:, None] * 3 + np.arange(3)).ravel()
        free = np.unique(source[~self.loads.prescribed[source]])
        column = np.full(3 * self.nodes, -1)
        column[free] = np.arange(len(free))
        rows = np.flatnonzero(column[source] >= 0)
        return csr_matrix((np.ones(len(rows)), (rows, column[source[rows]])), (3 * self.nodes, len(free)))

    def points_of(self, name: str, places: np.ndarray) -> np.ndarray:
        """Return the points of an interface of the section below or above points of the surface, shape (n,).

        Parameters
        ----------
        places : ndarray, shape (n, 3)
            Coordinates [m].
        """
        if len(places) == 0:
            return np.zeros(0, dtype=np.int64)
        _, number = closest(places[:, :2], self.faces[name].points)
        return np.asarray(number)

    def surface(self, face: Interface, name: str) -> Interface:
        """Return the surface of an interface with the areas of the section, all points along strike alike."""
        assert self.mesh_table.along_strike is not None
        weight = self.faces[name].weight[self.points_of(name, face.points)]
        return replace(face, weight=weight * self.mesh_table.along_strike.spacing)

    def jumps(self, names: Sequence[str]) -> tuple[csr_matrix, np.ndarray]:
        """Return J of the points of some interfaces, one after the other, and their lengths [m].

        J has shape (3 points, 3 nodes). The length of a point is repeated for each component, shape (3 points,).
        """
        rows, columns, values, offset = [], [], [], 0
        for name in names:
            nodes, blocks = self.faces[name].stencil()
            n, sides = nodes.shape
            row = offset + 3 * np.arange(n)[:, None, None, None] + np.arange(3)[:, None]
            column = nodes[:, :, None, None] * 3 + np.arange(3)
            rows.append(np.broadcast_to(row, (n, sides, 3, 3)).ravel())
            columns.append(np.broadcast_to(column, (n, sides, 3, 3)).ravel())
            values.append(blocks.ravel())
            offset += 3 * n
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        weights = np.concatenate([self.faces[name].weight for name in names])
        return csr_matrix(entries, (offset, 3 * self.nodes)), np.repeat(weights, 3)


def _with_strike(face: Interface) -> Interface:
    """Return an interface of a section whose local directions are the normal, z and the tangent."""
    n, (x, y) = len(face.plus), face.frame[:, 0].T
    none, one = np.zeros(n), np.ones(n)
    rows = [[x, y, none], [none, none, one], [y, -x, none]]
    return replace(face, frame=np.moveaxis(np.array(rows).reshape(3, 3, n), 2, 0))
