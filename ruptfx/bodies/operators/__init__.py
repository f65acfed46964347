"""Bulk operators, one per file; the file name is `operator` in a case.

`ufl_form` is the definition: the derivative of the UFL energy, evaluated through FFCx. Every other operator must
agree with it to round-off.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, runtime_checkable

import numpy as np

from ruptfx.input.plugins import Plugin, active
from ruptfx.input.schema import CaseError, from_outside, kinds, nearest, own_module
from ruptfx.laws.materials import Material, Plane
from ruptfx.laws.materials.stiffness import linear_stiffness
from ruptfx.platform.codegen.native import DOUBLE

if TYPE_CHECKING:
    from ruptfx.bodies.space.variation import Variation
    from ruptfx.platform import fem

SHARED = ("diagonal", "geometry", "memory_sweep")
"""Files of this folder that are no kinds."""


@dataclass(frozen=True)
class Bulk:
    """Input of an operator: the bodies.

    Attributes
    ----------
    space : dolfinx.fem.FunctionSpace
        Blocked Lagrange space; on quadrilaterals and hexahedra with Gauss-Lobatto-Legendre points.
    plane : str
        Plane stress, plane strain, antiplane or solid.
    materials : list of Material
    cell_material : ndarray of int32, shape (cells,)
        Index into `materials` of every local cell (ghosts included).
    only : ndarray of bool or None, shape (cells,)
        True for local cells that contribute; None for all.
    large_rotations : bool
        True for Biot strains, U - 1, instead of the symmetric gradient.
    variation : Variation or None
        Parameters of materials that vary in the bodies.
    real : dtype
        Type of velocities and forces, and of the numbers of operators that compute in either.
    """

    space: fem.dolfinx.fem.FunctionSpace
    plane: Plane
    materials: list[Material]
    cell_material: np.ndarray
    only: np.ndarray | None = None
    large_rotations: bool = False
    variation: Variation | None = None
    real: np.dtype = DOUBLE

    def material_in_forms(self, index: int) -> Material:
        """Return a material with functions in place of parameters that vary."""
        return self.materials[index] if self.variation is None else self.variation.in_forms(index)

    @property
    def isotropic(self) -> bool:
        """True if all materials are linear and isotropic."""
        return all(material.lame(self.plane) is not None for material in self.materials)

    def moduli(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the moduli of cells [Pa]: those of Lamé if all bodies are isotropic, else the stiffness.

        The stiffness is given by its rows up to the diagonal, one after the other, with shear strains counted twice.
        Its components are xx, yy, xy, axisymmetric also zz; in 3D xx, yy, zz, xy, yz, xz; antiplane xz, yz.

        Parameters
        ----------
        cells : ndarray of int
            Local cells.

        Returns
        -------
        ndarray, shape (*cells.shape, moduli)
            Those of the cells, of their first point where they vary.
        ndarray or None, shape (*cells.shape, points, moduli)
            Those of the nodes of the elements in their own order; None if they are uniform in all these cells.

        Raises
        ------
        RuptfxError
            An energy that is not quadratic.
        """
        index = self.cell_material[cells]
        isotropic = self.isotropic

        def of(material: Material) -> np.ndarray:
            lame = material.lame(self.plane)
            if lame is None:
                return _lower_rows(material, self.plane)
            first, shear = (each[..., None] for each in np.broadcast_arrays(*lame))
            if isotropic:
                return np.concatenate([first, shear], axis=-1)
            by_first, by_shear = _stiffness_by_lame(self.plane)
            return np.asarray(first * by_first + shear * by_shear)

        moduli = np.array([of(material) for material in self.materials])
        if self.variation is None:
            return moduli[index], None
        count = self.variation.points(cells.ravel()[:1]).shape[1]
        values = np.repeat(moduli[index][..., None, :], count, axis=-2)
        for number in np.unique(index):
            if self.variation.varies(number):
                mine = index == number
                local = self.variation.local(number, cells[mine])
                if local.lame(self.plane) is not None:  # that of others does not vary: `MatrixFree` refuses it
                    values[mine] = of(local)
        uniform = bool(np.all(values == values[..., :1, :]))
        return np.ascontiguousarray(values[..., 0, :]), None if uniform else values


STRAINS: dict[str, list[tuple[int, int]]] = {
    "antiplane": [(0, 2), (1, 2)], "axisymmetric": [(0, 0), (1, 1), (0, 1), (2, 2)],
    "solid": [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)],
}  # fmt: skip
"""Order of the components of strain and stress by plane; plane stress and strain have the first three of axisymmetric
bodies."""


def _strains(plane: Plane) -> list[tuple[int, int]]:
    return STRAINS.get(plane, STRAINS["axisymmetric"][:3])


def _rows(stiffness: np.ndarray) -> np.ndarray:
    """Return the rows of a matrix up to its diagonal, one after the other."""
    return np.asarray(stiffness[np.tril_indices(len(stiffness))])


def _lower_rows(material: Material, plane: Plane) -> np.ndarray:
    """Return the rows of the stiffness of a material up to its diagonal [Pa]."""
    stiffness = linear_stiffness(material, plane)
    if plane == "antiplane":
        return _rows(stiffness)
    strains = _strains(plane)
    return _rows(np.array([[stiffness[(*row, *column)] for column in strains] for row in strains]))


def _stiffness_by_lame(plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of the rows of an isotropic stiffness by both Lamé moduli."""
    normal = np.array([float(i == j) for i, j in _strains(plane)])
    return _rows(np.outer(normal, normal)), _rows(np.diag(1 + normal))


class Operator(Protocol):
    """Application of K to vectors of local degrees of freedom, ghosts included, shape (nodes * components,).

    Contributions of the cells owned by the rank are *added*; the caller sums over ranks.
    """

    def __init__(self, bulk: Bulk) -> None: ...

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """Subtract K displacement from `force` [N], in place."""


@runtime_checkable
class EnergyOperator(Operator, Protocol):
    """Operator that evaluates the strain energy, needed if the energy is not a quadratic form."""

    def energy(self, displacement: np.ndarray) -> float:
        """Return the strain energy of the cells owned by this rank [J, per metre of thickness in 2D]."""


@runtime_checkable
class ViscousOperator(EnergyOperator, Protocol):
    """Operator with the Kelvin-Voigt damping of bodies that rotate."""

    def add_viscous_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Subtract the force of the stress F C : dE/dt of the cells owned by this rank from `force` [N/s], in place.

        E is Green's strain: dE/dt = sym(F' grad v) with F = 1 + grad u, zero in rigid motion at any angle. The power of
        this force is that of the stress C : dE/dt, so it never drives, and it has no moment.
        """


@dataclass
class Damped:
    """Kelvin-Voigt damping of all elements in a step: the force -eta K v.

    Attributes
    ----------
    eta : float
        [s]
    force : ndarray, shape (nodes * components,)
        Damping force [N], also part of the force of the step; zero before it, and after it at updated nodes.
    lost : ndarray, shape (1,)
        Sum to which the power dissipated at updated nodes is added [W].
    """

    eta: float
    force: np.ndarray
    lost: np.ndarray


class InsertedSweep(Protocol):
    """Compiled sweep over elements with a stress that is not elastic, which a bulk kernel calls."""

    batches: np.ndarray
    """Local cells, shape (batches, lanes); padding cells repeat others."""

    def call(self, state: np.ndarray) -> tuple[int, int, int]:
        """Return the addresses of the C function `add_force`, of its plan and of its memory (`struct sweep`)."""


def nodes_of_sweeps(space: fem.dolfinx.fem.FunctionSpace, sweeps: Iterable[InsertedSweep]) -> np.ndarray:
    """Return a mask of the local nodes of the elements of sweeps, shape (nodes,)."""
    index_map = space.dofmap.index_map
    nodes = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
    for sweep in sweeps:
        nodes[space.dofmap.list[sweep.batches]] = True
    return nodes


@dataclass
class Inelastic:
    """Stress in a step that is not elastic: of materials with memory, or Kelvin-Voigt damping of some elements.

    Attributes
    ----------
    sweeps : list of InsertedSweep
    force : ndarray, shape (nodes * components,)
        Force of that stress [N]; zero before the step, and after it at updated nodes. At the others the caller adds it.
    power : ndarray, shape (2,)
        Sums to which the power of the force at updated nodes is added [W]: with the old and with the new velocity.
    states : list of ndarray
        States of the points of each sweep, advanced in the step; of damping the velocities.
    dt : float
        Time since the last advance of the states [s].
    """

    sweeps: Sequence[InsertedSweep]
    force: np.ndarray
    power: np.ndarray
    states: Sequence[np.ndarray] = ()
    dt: float = 0.0


StepPart = Literal["all", "boundary", "interior"]
"""Elements of a step: all of them, those at nodes shared with other ranks, or the others."""


@runtime_checkable
class FusedOperator(Operator, Protocol):
    """Operator that also makes explicit steps: it updates nodes as soon as their force is complete."""

    @property
    def damps(self) -> bool:
        """True if its steps include the damping of all elements."""

    def prepare_step(
        self, by_caller: np.ndarray, sweeps: Sequence[InsertedSweep] = (), moves: bool = False
    ) -> None:  # fmt: skip
        """Set which nodes steps leave to the caller, shape (nodes,), the sweeps of `Inelastic`, and whether to `move`.

        Nodes shared with other ranks are always left to the caller.
        """

    def step(  # noqa: PLR0913
        self,
        displacement: np.ndarray,
        velocity: np.ndarray,
        force: np.ndarray,
        inverse_mass: np.ndarray,
        dt: float,
        decay: float = 1.0,
        energy: np.ndarray | None = None,
        damped: Damped | None = None,
        inelastic: Inelastic | None = None,
        part: StepPart = "all",
        move: float = 0.0,
    ) -> float:
        """Make a step, as `MatrixFree.step`, or one of its two parts."""


@runtime_checkable
class LayerOperator(Operator, Protocol):
    """Operator whose elements can be damped within the steps of a `FusedOperator`."""

    def viscous_sweep(self, eta: float) -> InsertedSweep:
        """Return the damping of its elements, the force -eta K v, for steps of another operator."""


def create(kind: str, bulk: Bulk, plugins: Iterable[Plugin] = ()) -> Operator:
    """Return the operator of a kind: the class in `operators/<kind>.py`, its name in CamelCase, or a plug-in."""
    with active(plugins):
        if kind not in kinds("ruptfx.bodies.operators"):
            raise CaseError(f"operator = '{kind}': unknown, {nearest(kind, kinds('ruptfx.bodies.operators'))}")
        outside = from_outside("ruptfx.bodies.operators", kind)
    name = "".join(word.capitalize() for word in kind.split("_"))
    cls = outside or getattr(own_module("ruptfx.bodies.operators", kind), name)
    if bulk.real != DOUBLE and not getattr(cls, "any_precision", False):
        raise CaseError(
            f"precision = 'single': operator = '{kind}' computes in double precision; remove the line, or use operator "
            "= 'matrix_free'"
        )
    made = cls(bulk)
    if bulk.large_rotations and not isinstance(made, EnergyOperator):
        raise CaseError(
            f"operator = '{kind}': has no strain energy of bodies that turn, which large_rotations needs; use "
            "operator = 'matrix_free' or 'ufl_form'"
        )
    return made
