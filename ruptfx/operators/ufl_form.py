"""The reference operator: the UFL form of the internal force, assembled at every call."""

from __future__ import annotations

import numpy as np

from ruptfx import fem
from ruptfx.operators import Bulk


def strain(displacement: fem.ufl.core.expr.Expr) -> fem.ufl.core.expr.Expr:
    """Symmetric gradient; of a scalar (antiplane) displacement its gradient."""
    gradient = fem.ufl.grad(displacement)
    return gradient if len(displacement.ufl_shape) == 0 else fem.ufl.sym(gradient)


def material_tags(bulk: Bulk) -> fem.dolfinx.mesh.MeshTags:
    """The material index of every local cell as tags for a measure."""
    mesh = bulk.space.mesh
    cells = np.arange(len(bulk.cell_material), dtype=np.int32)
    return fem.dolfinx.mesh.meshtags(mesh, mesh.topology.dim, cells, bulk.cell_material)


def energy(bulk: Bulk, displacement: fem.ufl.core.expr.Expr) -> fem.ufl.Form:
    """Strain energy of the bodies [J, per metre of thickness in 2D]."""
    mesh = bulk.space.mesh
    order = bulk.space.element.basix_element.degree
    dx = fem.ufl.Measure(
        "dx", domain=mesh, subdomain_data=material_tags(bulk), metadata=fem.gll_metadata(mesh, order)
    )
    return sum(
        material.energy_density(strain(displacement), bulk.plane) * dx(index)
        for index, material in enumerate(bulk.materials)
    )


class UflForm:
    """Assembles the derivative of the strain energy; any material, any mesh, any order."""

    def __init__(self, bulk: Bulk) -> None:
        space = bulk.space
        self._displacement = fem.dolfinx.fem.Function(space)
        self._viscosity = None
        if bulk.viscosity_time is not None:
            cellwise = fem.dolfinx.fem.functionspace(space.mesh, ("DG", 0))
            self._viscosity = fem.dolfinx.fem.Function(cellwise)
            self._viscosity.x.array[:] = bulk.viscosity_time[: len(self._viscosity.x.array)]
            self._velocity = fem.dolfinx.fem.Function(space)
        test = fem.ufl.TestFunction(space)
        form = fem.ufl.derivative(energy(bulk, self._displacement), self._displacement, test)
        if self._viscosity is not None:
            # Linear viscosity: the force of the velocity field, cell by cell scaled by eta.
            rate = fem.ufl.derivative(form, self._displacement, self._viscosity * self._velocity)
            form = form + rate
        self._force = fem.dolfinx.fem.form(form, jit_options=fem.JIT_OPTIONS)

    def add_internal_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        self._displacement.x.array[:] = displacement
        if self._viscosity is not None:
            self._velocity.x.array[:] = velocity
        assembled = np.zeros_like(force)
        fem.dolfinx.fem.assemble_vector(assembled, self._force)
        force -= assembled
