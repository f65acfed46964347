"""Ways to apply the bulk operator, one per file; the file name is `operator` in a case.

`ufl_form` is the definition: the derivative of the UFL energy, evaluated through FFCx. Every other operator must
agree with it to round-off.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from ruptfx.materials import Material, Plane
from ruptfx.plugins import Plugin, active
from ruptfx.schema import CaseError, from_outside, kinds, nearest, own_module

if TYPE_CHECKING:
    from ruptfx import fem


@dataclass(frozen=True)
class Bulk:
    """What an operator needs to know about the bodies.

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
        Local cells that count; None for all.
    large_rotations : bool
        Whether strains are those of Biot, U - 1, and not the symmetric gradient.
    """

    space: fem.dolfinx.fem.FunctionSpace
    plane: Plane
    materials: list[Material]
    cell_material: np.ndarray
    only: np.ndarray | None = None
    large_rotations: bool = False


class Operator(Protocol):
    """Applies K to vectors of local degrees of freedom, ghosts included, shape (nodes * components,).

    Contributions of the cells a rank owns are *added*; summing over ranks is the caller's business.
    """

    def __init__(self, bulk: Bulk) -> None: ...

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """force -= K displacement."""


@runtime_checkable
class EnergyOperator(Operator, Protocol):
    """An operator that knows the strain energy itself: where that is no quadratic form, forces do not tell it."""

    def energy(self, displacement: np.ndarray) -> float:
        """Strain energy of the cells this rank owns [J, per metre of thickness in 2D]."""


@dataclass
class Damped:
    """Kelvin-Voigt damping of all elements in a step: the force -eta K v.

    Attributes
    ----------
    eta : float
        [s]
    force : ndarray, shape (nodes * components,)
        That force [N], in the force of the step, too; zero before it, and after it where nodes have moved on.
    lost : ndarray, shape (1,)
        What it takes of the nodes that move on, over the time that forces act, is added to it [W].
    """

    eta: float
    force: np.ndarray
    lost: np.ndarray


@runtime_checkable
class FusedOperator(Operator, Protocol):
    """An operator that can also make explicit steps: it moves nodes on as soon as their force is complete."""

    @property
    def damps(self) -> bool:
        """Whether its steps know the damping of all elements."""

    def prepare_step(self, held: np.ndarray) -> None:
        """Say which nodes steps leave to the caller, shape (nodes,); nodes known to other ranks in any case."""

    def step_boundary(
        self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, inverse_mass: np.ndarray,
        dt: float, decay: float = 1.0, energy: np.ndarray | None = None, damped: Damped | None = None,
    ) -> float:
        """First part of a step, as `MatrixFree.step`: the elements at nodes that other ranks know."""

    def step_interior(
        self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, inverse_mass: np.ndarray,
        dt: float, decay: float = 1.0, energy: np.ndarray | None = None, damped: Damped | None = None,
    ) -> float:
        """The rest of the step."""


def create(kind: str, bulk: Bulk, plugins: Iterable[Plugin] = ()) -> Operator:
    """The operator of a kind: the class in `operators/<kind>.py`, its name in CamelCase, or one from outside."""
    with active(plugins):
        if kind not in kinds("ruptfx.operators"):
            raise CaseError(f"operator = '{kind}': unknown, {nearest(kind, kinds('ruptfx.operators'))}")
        outside = from_outside("ruptfx.operators", kind)
    name = "".join(word.capitalize() for word in kind.split("_"))
    return (outside or getattr(own_module("ruptfx.operators", kind), name))(bulk)
