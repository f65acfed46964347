"""The reference operator: the UFL form of the internal force, assembled at every call."""

from __future__ import annotations

import numpy as np

from ruptfx import Table, axisymmetry, fem
from ruptfx.materials import Plane
from ruptfx.operators import Bulk


def strain(displacement: fem.Expr, mesh: fem.dolfinx.mesh.Mesh, plane: Plane) -> fem.Expr:
    """Symmetric gradient; of a scalar (antiplane) displacement its gradient, around an axis with the third strain."""
    if plane == "axisymmetric":
        return axisymmetry.strain(displacement, mesh)
    gradient = fem.ufl.grad(displacement)
    return gradient if len(displacement.ufl_shape) == 0 else fem.ufl.sym(gradient)


def material_tags(bulk: Bulk) -> fem.dolfinx.mesh.MeshTags:
    """The material index of every local cell as tags for a measure."""
    mesh = bulk.space.mesh
    cells = np.arange(len(bulk.cell_material), dtype=np.int32)
    if bulk.only is not None:
        cells = cells[bulk.only]
    return fem.dolfinx.mesh.meshtags(mesh, mesh.topology.dim, cells, bulk.cell_material[cells])


def measure(bulk: Bulk) -> fem.ufl.Measure:
    """Cells by material, with the quadrature that belongs to the element."""
    mesh = bulk.space.mesh
    order = bulk.space.element.basix_element.degree
    return fem.ufl.Measure(
        "dx", domain=mesh, subdomain_data=material_tags(bulk), metadata=fem.gll_metadata(mesh, order)
    )


def energy_density(bulk: Bulk, index: int, strain: fem.Expr) -> fem.Expr:
    """Of one of the materials; what goes round an axis is solid to it."""
    seen: Plane = "solid" if bulk.plane == "axisymmetric" else bulk.plane
    return bulk.materials[index].energy_density(strain, seen)


def energy(bulk: Bulk, displacement: fem.Expr, dx: fem.ufl.Measure) -> fem.ufl.Form:
    """Strain energy of the bodies [J, per metre of thickness in plane stress, plane strain and antiplane]."""
    mesh = bulk.space.mesh
    e = strain(displacement, mesh, bulk.plane)
    return sum(
        axisymmetry.around(energy_density(bulk, index, e), mesh, bulk.plane) * dx(index)
        for index in range(len(bulk.materials))
    )


class UflForm:
    """Assembles the derivative of the strain energy; any material, any mesh, any order.

    Parameters
    ----------
    bulk : Bulk
    jit_options : dict
        How the form is compiled; empty for DOLFINx's own flags.
    """

    def __init__(self, bulk: Bulk, jit_options: Table = fem.JIT_OPTIONS) -> None:
        space = bulk.space
        self._displacement = fem.dolfinx.fem.Function(space)
        test = fem.ufl.TestFunction(space)
        dx, u = measure(bulk), self._displacement
        form = fem.ufl.derivative(energy(bulk, u, dx), u, test)
        self._force = fem.dolfinx.fem.form(form, jit_options=jit_options)

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        self._displacement.x.array[:] = displacement
        assembled = np.zeros_like(force)
        fem.dolfinx.fem.assemble_vector(assembled, self._force)
        force -= assembled
