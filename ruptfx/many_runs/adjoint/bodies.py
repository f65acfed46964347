"""Derivatives of the coefficients of a step by the constants of elastic bodies.

Density and moduli are in the stiffness K and its damping eta K_v, the mass m, the dashpots d, the impedances of the
interfaces, elastic supports and applied forces. Readings of stress, whose weights contain moduli, have no adjoint. With
the time t of a kick the update of a velocity, v = keep v + push f, has

    c = t d / 2        keep = (m - c) / (m + c)        push = t / (m + c)

The stiffness is linear in Lamé's moduli, so that its derivative is the operator with their derivatives in their place.
Dashpots, supports and applied forces are computed by the code of the boundaries, of which differences of fourth order
are taken, with an error of 1e-12 of them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies import operators
from ruptfx.bodies.boundaries.loading import Loads
from ruptfx.bodies.space import axisymmetry
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, masses_and_dashpots
from ruptfx.laws.materials import Material, Plane
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.platform import fem

if TYPE_CHECKING:
    from ruptfx.run.model import Model

Floats = NDArray[np.float64]
DIFFERENCES = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
"""Places and weights of central differences of fourth order."""
PART = 1e-3
"""Change of the constants in these differences, relative."""
CONSTANTS = {"density": "kg/m3", "young_modulus": "Pa", "poisson_ratio": "1", "c_p": "m/s", "c_s": "m/s"}
"""Constants of isotropic bodies by which a run is differentiated, and their units."""


def constants_of(model: Model) -> Iterator[tuple[str, str, str]]:
    """Yield material, constant and unit of the uniform isotropic bodies of a model."""
    for name, material in model.case.materials.items():
        used = _bodies(model, name)
        if used and isinstance(material, IsotropicElastic) and not material.has_memory() and not material.varying:
            for constant, unit in CONSTANTS.items():
                yield name, constant, unit


def _bodies(model: Model, name: str) -> list[int]:
    """Return the numbers of the bodies of a material of the case."""
    others = set(model.case.materials) - {"default"}
    return [
        number for number, body in enumerate(model.bodies.names)
        if body == name or (name == "default" and body not in others)
    ]  # fmt: skip


def direction(material: IsotropicElastic, constant: str) -> dict[str, float]:
    """Return the derivatives of density, Young's modulus and Poisson's ratio by a constant.

    Density, modulus and ratio are independent; the wave speeds of the bulk keep each other and the density:
    nu = (r - 2) / (2 (r - 1)) with r = (c_p / c_s)^2, and E = 2 rho c_s^2 (1 + nu).
    """
    if constant not in ("c_p", "c_s"):
        return {constant: 1.0}
    rho, nu = material.density, material.poisson_ratio
    assert isinstance(rho, float | int)
    c_s = float(np.sqrt(material.shear_modulus / rho))
    r = 2 * (1 - nu) / (1 - 2 * nu)
    by_r = 0.5 / (r - 1) ** 2
    of_nu = by_r * 2 * r / (c_s * np.sqrt(r)) if constant == "c_p" else -by_r * 2 * r / c_s
    of_young = 2 * rho * c_s**2 * of_nu + (4 * rho * c_s * (1 + nu) if constant == "c_s" else 0.0)
    return {"young_modulus": float(of_young), "poisson_ratio": float(of_nu)}


def value_of(material: IsotropicElastic, constant: str) -> float:
    """Return a constant of a uniform material."""
    rho = material.density
    assert isinstance(rho, float | int)
    if constant == "c_s":
        return float(np.sqrt(material.shear_modulus / rho))
    if constant == "c_p":
        return float(np.sqrt((material.lame_lambda("strain") + 2 * material.shear_modulus) / rho))
    return float(getattr(material, constant))


@dataclass(frozen=True)
class ModuliChange:
    """Derivative of an isotropic material by a constant, in the place of a material of operators.

    Attributes
    ----------
    first, shear : float
        Derivatives of Lamé's moduli, in plane stress of the effective ones.
    """

    first: float
    shear: float

    @staticmethod
    def has_memory() -> bool:
        """Return False: the points of such a body have no state."""
        return False

    def lame(self, plane: Plane) -> tuple[float, float]:
        """Return the derivatives of Lamé's moduli."""
        return self.first, self.shear

    def energy_density(self, strain: Any, plane: Plane) -> Any:
        """Return the derivative of the energy density, as a UFL expression."""
        ufl = fem.ufl
        if plane == "antiplane":
            return 0.5 * self.shear * ufl.inner(strain, strain)
        return 0.5 * self.first * ufl.tr(strain) ** 2 + self.shear * ufl.inner(strain, strain)


class ConstantChange:
    """Derivatives of all coefficients of a step by one constant of a material; collective."""

    def __init__(self, model: Model, material: str, constant: str) -> None:
        self._model, self._bodies = model, _bodies(model, material)
        base = model.case.materials[material]
        assert isinstance(base, IsotropicElastic)
        self._base, self._direction = base, direction(base, constant)
        self._cells = np.isin(model.bodies.cell_body, self._bodies)
        mass = self._direction.get("density", 0.0) * self._mass_per_density()
        self._views = list(self._changed(mass))
        self._mass, self._dashpot = self._of_nodes(mass)
        self._stiffness = self._viscous = None
        first, shear = self._moduli()
        if first or shear:
            self._stiffness = self._operator(model.bulk, ModuliChange(first, shear), self._cells)
            if (viscosity := model.viscosity) is not None:
                inside = self._cells & np.asarray(viscosity.bulk.only)
                self._viscous = self._operator(viscosity.bulk, ModuliChange(first, shear), inside)
        self._supports = [
            (each.nodes, sum(weight * view.loads.supports[number].stiffness for view, weight in self._views))
            for number, each in enumerate(model.loads.supports)
        ]

    def _mass_per_density(self) -> Floats:
        """Return the lumped mass of the bodies for a density of one."""
        model = self._model
        density = self._cells.astype(float)
        test = model.around(model.sum_of(fem.ufl.TestFunction(model.space)))
        mass = fem.assemble_summed(model.space, model.by_cell(density) * test * model.measure())
        if model.plane == "axisymmetric":
            gained = axisymmetry.mass_on_axis(model.space, density)
            model.layout.sum_shared(gained)
            mass += gained
        return mass

    def _moduli(self) -> tuple[float, float]:
        """Return the derivatives of Lamé's moduli by a complex step, exact to rounding."""
        step = 1e-30
        changed = self._base.with_values({
            name: getattr(self._base, name) + 1j * step * change for name, change in self._direction.items()
        })  # fmt: skip
        first, shear = changed.lame(self._model.plane)  # type: ignore[misc]
        return float(np.imag(first) / step), float(np.imag(shear) / step)

    def _operator(
        self, bulk: operators.Bulk, change: ModuliChange, cells: NDArray[np.bool_]
    ) -> tuple[operators.Operator, bool]:
        """Return the operator of the changed moduli, and whether this rank has cells of it; collective."""
        model, owned = self._model, self._model.mesh.topology.index_map(self._model.mesh.topology.dim).size_local
        is_present = bool(cells[:owned].any())
        cells = cells.copy()
        if not is_present:
            cells[0] = True  # an operator needs an element
        materials: Any = [change] * len(bulk.materials)
        made = replace(bulk, materials=materials, only=cells, variation=None)
        return operators.create(model.case.operator, made, model.case.loaded), is_present

    def _changed(self, mass: Floats) -> Iterator[tuple[Model, float]]:
        """Yield models with changed materials, masses and loads, and their weights in the derivative."""
        model, base = self._model, self._base
        room = {"poisson_ratio": 0.5 - base.poisson_ratio}
        relative = [abs(by) / room.get(name, getattr(base, name)) for name, by in self._direction.items()]
        step = PART / max(relative)
        for place, weight in DIFFERENCES:
            values = {name: getattr(base, name) + place * step * by for name, by in self._direction.items()}
            changed: Material = base.with_values(values)
            view = copy.copy(model)
            view.materials = [
                changed if number in self._bodies else each for number, each in enumerate(model.materials)
            ]
            view.given = view.materials
            view.mass = model.mass + place * step * mass
            view.loads = Loads(view, model.case.boundaries)
            yield view, weight / step

    def _of_nodes(self, mass: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of mass and dashpot of every degree of freedom, sums for tied ones."""
        model = self._model
        dashpot: Floats = np.sum([weight * view.loads.dashpot for view, weight in self._views], axis=0)
        both = mass.copy(), dashpot + model.case.damping.mass * mass
        for values in both:
            model.layout.sum_tied(values)
        return both

    # -- the parts of a step ---------------------------------------------------------------------------------------

    def of_kick(self, kick: Kick) -> KickChange:
        """Return the changes of the diagonal factors of a step."""
        model, half = self._model, 0.5 * kick.clock.kick
        mass, dashpot = masses_and_dashpots(model)
        free = ~model.loads.prescribed
        inverse = free / (mass + half * dashpot)
        added, less = self._mass + half * self._dashpot, self._mass - half * self._dashpot
        keep = (mass - half * dashpot) * inverse
        relative = -added * inverse
        faults = [_impedances(each.interface, inverse, relative * inverse, kick.clock.kick) for each in model.faults]
        return KickChange((less - keep * added) * inverse, relative, faults)

    def force(self, displacement: Floats, velocity: Floats, time: float) -> Floats:
        """Return the change of the force on the bodies at given motion, complete at every local node; collective."""
        model = self._model
        force = np.zeros_like(displacement)
        if self._viscous is not None and model.viscosity is not None:
            operator, is_present = self._viscous
            if is_present:
                operator.add_internal_force(velocity, force)
            force *= model.viscosity.eta
        if self._stiffness is not None:
            operator, is_present = self._stiffness
            if is_present:
                operator.add_internal_force(displacement, force)
            model.layout.sum_shared(force)
        for view, weight in self._views:
            for load in view.loads.forces:
                force[load.dofs] += weight * load.factor(time) * load.values
        u, total = displacement.reshape(-1, model.components), force.reshape(-1, model.components)
        for nodes, stiffness in self._supports:
            total[nodes] -= np.einsum("nij,nj->ni", stiffness, u[nodes])
        return force


@dataclass(frozen=True)
class KickChange:
    """Changes of the diagonal factors of a step.

    Attributes
    ----------
    keep, push : ndarray, shape (nodes * components,)
        Change of keep, and relative one of push and of the velocity by an impulse in contact.
    impedances : list of ndarray, shape (1 + tangents, n)
        Of every fault: normal impedance and shear impedances.
    """

    keep: Floats
    push: Floats
    impedances: list[Floats]


def _impedances(face: Interface, inverse: Floats, change: Floats, kick: float) -> Floats:
    """Return the change of the impedances, z = 1 / (kick w M), from that of the inverse mass, M = rows^2 (1/m)."""
    c = face.frame.shape[2]

    def mobility(values: Floats) -> Floats:
        nodal = values.reshape(-1, c)
        both = nodal[face.plus] + (0 if face.one_sided else nodal[face.minus])
        return np.einsum("ikc,ic->ik", face.rows**2, both)

    size = mobility(inverse)
    size = np.maximum(size, 1e-8 * size.max(initial=1e-300))  # as `impedances`
    z = -mobility(change) / (kick * face.weight[:, None] * size**2)
    return np.concatenate([z[:, :1], z[:, face.frame.shape[1] - face.tangents :]], axis=1).T
