"""The bodies in finite elements: mesh, materials, function space, nodes and measures, without the forces on them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from ruptfx.bodies.space import axisymmetry
from ruptfx.bodies.space.bodies import Bodies
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.bodies.space.numbering import in_sweep_order
from ruptfx.bodies.space.variation import Variation
from ruptfx.input.schema import CaseError, nearest
from ruptfx.laws.materials import Material, Plane
from ruptfx.laws.materials.stiffness import require_positive_energy
from ruptfx.platform import fem, parallel


class Discretisation:
    """Bodies in finite elements.

    Parameters
    ----------
    comm : MPI communicator
    materials : mapping of str to Material
        By name of a body; "default" for the others.
    order : int
        Of the elements.
    broken : bool
        True if every cell has nodes of its own.

    Attributes
    ----------
    space : dolfinx FunctionSpace
        Displacements.
    layout : Nodes
    materials : list of Material
        In the order of the bodies. Where parameters vary, with their numbers at the point with the slowest S waves.
    given : list of Material
        As in the case, with profiles.
    variation : Variation or None
        Parameters that vary in the bodies.
    mass : ndarray, shape (nodes * components,)
        Lumped mass of every local degree of freedom [kg].
    components : int
        Of a displacement.
    nodes, owned_nodes, total_nodes : int
        Of this rank with ghosts, owned by it, of all ranks.
    coordinates : ndarray, shape (nodes, dimensions)
        [m]
    oblique : ndarray of bool, shape (nodes,)
        Nodes of interfaces whose normal is not along an axis.

    Raises
    ------
    CaseError
        Elements of an order without diagonal mass, a mesh of other dimensions, bodies without material.
    """

    def __init__(
        self, comm: fem.MPI.Comm, bodies: Bodies, materials: Mapping[str, Material], plane: Plane, order: int,
        broken: bool,
    ) -> None:  # fmt: skip
        self.comm, self.bodies, self.plane, self.order = comm, bodies, plane, order
        self.mesh = bodies.mesh
        simplex = self.mesh.basix_cell().name in ("triangle", "tetrahedron")
        if simplex and order > 1:
            raise CaseError(
                f"order = {order}: must be 1 on triangles and tetrahedra, whose mass is not diagonal for others"
            )
        dim = self.mesh.geometry.dim
        if (dim == 3) != (plane == "solid"):
            raise CaseError(
                f"plane = '{plane}': the mesh has {dim} dimensions; use plane = 'solid' with three, another one with "
                "two"
            )
        self.components = self._count_components()
        if plane == "axisymmetric":
            parallel.raise_on_all(comm, axisymmetry.put_on_axis(self.mesh))
        self.space = (
            fem.broken_lagrange(self.mesh, self.components) if broken
            else in_sweep_order(fem.lagrange(self.mesh, order, self.components))
        )  # fmt: skip
        self.layout = Nodes(self.space, bodies)
        self.nodes, self.owned_nodes, self.total_nodes = self.layout.count, self.layout.owned, self.layout.total
        self.coordinates = self.layout.coordinates
        self.materials = self.given = _in_order(materials, bodies.names)
        self.variation: Variation | None = None
        if Variation.needed(self.given):
            self.variation = Variation(self.space, bodies.names, bodies.cell_body, self.given, plane)
            self.materials = self.variation.references
        self._require_positive_energies()
        self.mass = self._mass(range(len(bodies.names)))
        self.oblique = np.zeros(self.nodes, dtype=bool)

    def _count_components(self) -> int:
        return {"antiplane": 1, "solid": 3}.get(self.plane, 2)

    def _require_positive_energies(self) -> None:
        """Refuse materials of which some strain would release energy, where parameters vary also at their extremes.

        Raises
        ------
        CaseError
            On all ranks.
        """
        error = None
        for number, (name, material) in enumerate(zip(self.bodies.names, self.materials, strict=True)):
            extremes = self.variation.extremes(number) if self.variation is not None else []
            try:
                for each in [material, *extremes]:
                    if not each.isotropic:  # bounds of their keys keep those positive
                        require_positive_energy(each, self.plane, f"materials.{name}")
            except CaseError as caught:  # the points of a rank may differ
                error = error or caught
        parallel.raise_on_all(self.comm, error)

    def _mass(self, bodies: Collection[int]) -> np.ndarray:
        """Return the lumped mass of bodies at every local degree of freedom [kg], shape (nodes * components,)."""
        ufl = fem.ufl
        dx = self.measure()
        density: list[Any] = [material.density for material in self.materials_in_forms()]
        test = self.around(self.sum_of(ufl.TestFunction(self.space)))
        mass = fem.assemble_summed(self.space, sum(density[i] * test * dx(i) for i in bodies))
        if self.plane == "axisymmetric":
            inside = np.isin(self.bodies.cell_body, list(bodies))
            gained = axisymmetry.mass_on_axis(self.space, self._density_of_cells() * inside)
            self.layout.sum_shared(gained)
            mass += gained
        return mass

    def mass_of(self, body: int) -> np.ndarray:
        """Return the share of a body in the lumped mass, at every local degree of freedom [kg]; collective.

        It is all of the mass inside of the body, a part of it at nodes where others are welded to it, and zero
        elsewhere.
        """
        own = self.layout.touches[body]
        welds = own & (self.layout.touches.sum(axis=0) > 1)
        mass = np.where(np.repeat(own, self.components), self.mass, 0.0)
        if parallel.anywhere(self.comm, bool(welds.any())):
            at = np.repeat(welds, self.components)
            mass[at] = self._mass([body])[at]
        return mass

    def materials_in_forms(self) -> list[Material]:
        """Return the materials of the bodies with functions in place of parameters that vary."""
        if self.variation is None:
            return self.materials
        return [self.variation.in_forms(number) for number in range(len(self.materials))]

    def _density_of_cells(self) -> np.ndarray:
        """Return the mean density of the points of every local cell [kg/m3]."""
        if self.variation is not None:
            return np.asarray(self.variation.evaluate(lambda material, _: material.density).mean(axis=1))
        return np.array([material.density for material in self.materials])[self.bodies.cell_body]

    def measure(self) -> fem.ufl.Measure:
        """Return the measure of all cells with the quadrature of the mass, tagged by body."""
        cells = np.arange(len(self.bodies.cell_body), dtype=np.int32)
        tags = fem.dolfinx.mesh.meshtags(self.mesh, self.mesh.topology.dim, cells, self.bodies.cell_body)
        return fem.ufl.Measure(
            "dx", domain=self.mesh, subdomain_data=tags, metadata=fem.gll_metadata(self.mesh, self.order)
        )

    def around(self, density: fem.Expr) -> fem.Expr:
        """Return a density of the section times 2 pi r in axisymmetric cases, else as it is."""
        return axisymmetry.around(density, self.mesh, self.plane)

    def sum_of(self, vector: fem.ufl.core.expr.Expr) -> fem.ufl.core.expr.Expr:
        """Return the sum of the components of a vector expression."""
        return vector if self.components == 1 else sum(vector[i] for i in range(self.components))

    def edge_measure(self, tag: int | tuple[int, ...]) -> fem.ufl.Measure:
        """Return the measure of a named edge, or of one side of an interface."""
        return fem.ufl.Measure(
            "ds",
            domain=self.mesh,
            subdomain_data=self.bodies.facets,
            subdomain_id=tag,
            metadata=fem.gll_metadata(self.mesh, self.order),
        )

    @cached_property
    def _constants(self) -> fem.dolfinx.fem.FunctionSpace:
        """Function space of constants in every cell."""
        return fem.dolfinx.fem.functionspace(self.mesh, ("DG", 0))

    def by_cell(self, values: np.ndarray) -> fem.dolfinx.fem.Function:
        """Return a function that is constant in every cell, from values of all local cells."""
        function = fem.dolfinx.fem.Function(self._constants)
        cells = function.function_space.dofmap.list[:, 0]
        function.x.array[cells] = values[: len(cells)]
        return function


def _in_order(table: Mapping[str, Material], bodies: list[str]) -> list[Material]:
    """Return the material of every body, in the order of the bodies."""
    for name in table:
        if name not in (*bodies, "default"):
            raise CaseError(f"materials.{name}: no such body, {nearest(name, [*bodies, 'default'])}")
    missing = [name for name in bodies if name not in table and "default" not in table]
    if missing:
        raise CaseError(f"materials: body '{missing[0]}' has none; add [materials.{missing[0]}] or [materials.default]")
    return [table[name] if name in table else table["default"] for name in bodies]
