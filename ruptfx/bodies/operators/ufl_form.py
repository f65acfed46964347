"""Reference operator: the UFL form of the internal force, assembled at every call."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from ruptfx.bodies.operators import Bulk, ViscousOperator
from ruptfx.bodies.space import axisymmetry
from ruptfx.laws.materials import Plane
from ruptfx.platform import fem


def strain(displacement: fem.Expr, mesh: fem.dolfinx.mesh.Mesh, plane: Plane, large: bool = False) -> fem.Expr:
    """Return the symmetric gradient; in antiplane the gradient; around an axis with the hoop strain.

    With `large`, Biot's strain U - 1 in the plane, with F = 1 + grad u = R U.
    """
    if large:
        return _biot(displacement)
    if plane == "axisymmetric":
        return axisymmetry.strain(displacement, mesh)
    gradient = fem.ufl.grad(displacement)
    return gradient if len(displacement.ufl_shape) == 0 else fem.ufl.sym(gradient)


def _biot(displacement: fem.Expr) -> fem.Expr:
    """Return U - 1 in closed form: U^2 - tr(U) U + det(U) 1 = 0 (Cayley and Hamilton), tr(U)^2 = tr(U^2) + 2 det(U).

    With F = 1 + H, b = F_xy - F_yx and s = tr(U) = sqrt((2 + tr H)^2 + b^2); written so that small strains keep their
    digits: U - 1 = (U^2 - 1 + (det(F) - 1 - (s - 2)) 1) / s.
    """
    H = fem.ufl.grad(displacement)
    one, skew = fem.ufl.Identity(2), H[0, 1] - H[1, 0]
    C = 2 * fem.ufl.sym(H) + H.T * H  # U^2 - 1
    det = fem.ufl.tr(H) + H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0]  # det(F) - 1
    s = fem.ufl.sqrt((2 + fem.ufl.tr(H)) ** 2 + skew**2)
    beyond = (fem.ufl.tr(C) + 2 * det) / (s + 2)  # s - 2
    return (C + (det - beyond) * one) / s


def rotation(displacement: fem.Expr) -> fem.Expr:
    """Return R of the polar decomposition 1 + grad u = R U in the plane."""
    H = fem.ufl.grad(displacement)
    along, across = 2 + fem.ufl.tr(H), H[0, 1] - H[1, 0]
    s = fem.ufl.sqrt(along**2 + across**2)
    return fem.ufl.as_matrix([[along / s, across / s], [-across / s, along / s]])


def material_tags(bulk: Bulk) -> fem.dolfinx.mesh.MeshTags:
    """Return the material index of every local cell as tags for a measure."""
    mesh = bulk.space.mesh
    cells = np.arange(len(bulk.cell_material), dtype=np.int32)
    if bulk.only is not None:
        cells = cells[bulk.only]
    return fem.dolfinx.mesh.meshtags(mesh, mesh.topology.dim, cells, bulk.cell_material[cells])


def measure(bulk: Bulk, degree: int | None = None) -> fem.ufl.Measure:
    """Return the cell measure by material, with the quadrature of the element or one of a given degree."""
    mesh = bulk.space.mesh
    order = bulk.space.element.basix_element.degree
    rule = fem.gll_metadata(mesh, order) if degree is None else {"quadrature_degree": degree}
    return fem.ufl.Measure("dx", domain=mesh, subdomain_data=material_tags(bulk), metadata=rule)


def energy_density(bulk: Bulk, index: int, strain: fem.Expr) -> fem.Expr:
    """Return the energy density of one material; axisymmetric strains are three-dimensional (`solid`)."""
    seen: Plane = "solid" if bulk.plane == "axisymmetric" else bulk.plane
    return bulk.material_in_forms(index).energy_density(strain, seen)


def energy(bulk: Bulk, displacement: fem.Expr, dx: fem.ufl.Measure) -> fem.ufl.Form:
    """Return the strain energy of the bodies [J, in plane models per metre of thickness]."""
    mesh = bulk.space.mesh
    e = strain(displacement, mesh, bulk.plane, bulk.large_rotations)
    return sum(
        axisymmetry.around(energy_density(bulk, index, e), mesh, bulk.plane) * dx(index)
        for index in range(len(bulk.materials))
    )


class UflForm(ViscousOperator):
    """Assembly of the derivative of the strain energy; any material, any mesh, any order.

    Parameters
    ----------
    bulk : Bulk
    tuned : bool
        Compile the form for this processor; else with the flags that DOLFINx chooses.
    """

    def __init__(self, bulk: Bulk, tuned: bool = True) -> None:
        space = bulk.space
        self._bulk, self._tuned = bulk, tuned
        self._displacement = fem.dolfinx.fem.Function(space)
        test = fem.ufl.TestFunction(space)
        dx, u = measure(bulk), self._displacement
        form = fem.ufl.derivative(energy(bulk, u, dx), u, test)
        self._force = fem.form(form, tuned)

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        self._displacement.x.array[:] = displacement
        assembled = np.zeros_like(force)
        fem.dolfinx.fem.assemble_vector(assembled, self._force)
        force -= assembled

    def energy(self, displacement: np.ndarray) -> float:
        """Return the strain energy of the cells owned by this rank [J, per metre of thickness in 2D]."""
        self._displacement.x.array[:] = displacement
        return float(np.real(fem.dolfinx.fem.assemble_scalar(self._energy)))

    def add_viscous_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Subtract the force of the cells' viscous stress from `force`, as `ViscousOperator`."""
        self._displacement.x.array[:] = displacement
        self._velocity.x.array[:] = velocity
        assembled = np.zeros_like(force)
        fem.dolfinx.fem.assemble_vector(assembled, self._viscous)
        force -= assembled

    @cached_property
    def _velocity(self) -> fem.dolfinx.fem.Function[np.float64]:
        return fem.dolfinx.fem.Function(self._bulk.space, dtype=np.float64)

    @cached_property
    def _viscous(self) -> Any:
        """The derivative of Rayleigh's potential: of the energy density at the rate of Green's strain."""
        bulk, dx, velocity = self._bulk, measure(self._bulk), self._velocity
        F = fem.ufl.Identity(2) + fem.ufl.grad(self._displacement)
        rate = fem.ufl.sym(F.T * fem.ufl.grad(velocity))
        potential = sum(energy_density(bulk, index, rate) * dx(index) for index in range(len(bulk.materials)))
        form = fem.ufl.derivative(potential, velocity, fem.ufl.TestFunction(bulk.space))
        return fem.form(form, self._tuned)

    @cached_property
    def _energy(self) -> fem.dolfinx.fem.Form:
        stored = energy(self._bulk, self._displacement, measure(self._bulk))
        return fem.form(stored, self._tuned)
