"""The semi-discrete system as mechanisms, attachments, steppers and instruments know it.

`ruptfx.run.model.Model` makes it from a case. It stands below the case, whose parts are bound to it, and below the
model, which builds these parts: both import this module, not the other way round.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from ruptfx.bodies import operators
from ruptfx.bodies.space.discretisation import Discretisation

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries import Boundary
    from ruptfx.bodies.boundaries.loading import Loads
    from ruptfx.bodies.meshes import MeshSource
    from ruptfx.bodies.operators.memory_sweep import MemorySweep
    from ruptfx.bodies.state import State
    from ruptfx.input.schema import Part
    from ruptfx.interfaces.collisions.step import CollisionStep
    from ruptfx.interfaces.cracks.step import CrackStep
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms import Mechanism
    from ruptfx.interfaces.section import Section
    from ruptfx.laws.contact import Way
    from ruptfx.laws.materials import Material, Plane, WaveSpeeds
    from ruptfx.laws.materials.traced import TracedMaterial
    from ruptfx.platform import fem


class DampingTable(Protocol):
    """Damping in a case."""

    @property
    def mass(self) -> float:
        """Force per mass and velocity [1/s]."""

    @property
    def kelvin_voigt(self) -> object | None:
        """Viscosity of elements."""


class OutputTable(Protocol):
    """Output in a case."""

    @property
    def rupture_threshold(self) -> float:
        """Slip rate from which a point has ruptured [m/s]."""

    @property
    def interface_steps(self) -> int | None:
        """Steps between records of the interface."""


class StageTable(Protocol):
    """A stage in a case."""

    @property
    def duration(self) -> float:
        """Length of the stage [s]."""

    @property
    def damping(self) -> DampingTable | None:
        """Damping instead of that of the case."""


class StepperTable(Protocol):
    """Declarations of a stepper."""

    @property
    def time_schemes(self) -> tuple[Way, ...]:
        """Kinds of its steps."""

    @property
    def offers(self) -> frozenset[str]:
        """Capabilities, as `ruptfx.stepping.steppers.Stepper.offers`."""

    @property
    def adaptive(self) -> bool:
        """True if its steps vary."""


class CaseTables(Protocol):
    """The tables of a case that are read after the model has been built."""

    @property
    def plane(self) -> Plane:
        """Kind of the two-dimensional or three-dimensional problem."""

    @property
    def duration(self) -> float:
        """Simulated time [s]."""

    @property
    def impact_speed(self) -> float:
        """Largest driven velocity [m/s]."""

    @property
    def intervals(self) -> Mapping[str, float]:
        """Time between records [s]."""

    @property
    def initial_velocity(self) -> Mapping[str, Sequence[float]]:
        """Initial velocity of bodies [m/s]."""

    @property
    def faults(self) -> Mapping[str, Any]:
        """Tables of the interfaces by name."""

    @property
    def order(self) -> int:
        """Order of the elements."""

    @property
    def operator(self) -> str:
        """Kind of the bulk operator."""

    @property
    def mesh(self) -> MeshSource:
        """Table of the mesh."""

    @property
    def stressed_materials(self) -> Mapping[str, Material]:
        """Materials by name of the body."""

    @property
    def instruments(self) -> Sequence[Part]:
        """Tables of the instruments."""

    @property
    def boundaries(self) -> Sequence[Boundary]:
        """Conditions and loads."""

    @property
    def damping(self) -> DampingTable:
        """Damping of the bodies."""

    @property
    def output(self) -> OutputTable:
        """Saved data."""

    @property
    def stages(self) -> Sequence[StageTable]:
        """Stages of loading."""

    @property
    def stepper(self) -> StepperTable:
        """Time stepper."""


@dataclass(frozen=True)
class Viscosity:
    """Kelvin-Voigt damping of some elements: the force -eta K v, of bodies that rotate -eta K(u) v.

    Attributes
    ----------
    eta : float
        [s]
    bulk : Bulk
        Elements with this damping, for small rotations.
    operator : Operator
        Stiffness K of these elements.
    nodes : ndarray of bool, shape (nodes,)
        Nodes of the elements this rank owns.
    everywhere : bool
        Whether these are all elements, each of which has nodes of its own.
    rotates : bool
        Whether the bodies rotate by large angles.
    """

    eta: float
    bulk: operators.Bulk
    operator: operators.Operator
    nodes: np.ndarray
    everywhere: bool
    rotates: bool

    def add_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Add the force over eta of the cells owned by this rank [N/s]."""
        if self.rotates:
            assert isinstance(self.operator, operators.ViscousOperator)
            self.operator.add_viscous_force(displacement, velocity, force)
        else:
            self.operator.add_internal_force(velocity, force)


class System(Discretisation):
    """Bodies, interfaces, loads and mechanisms of a case: M a = -K u - C v - J' W (T - T_0) + boundary forces.

    Attributes
    ----------
    case : CaseTables
    bulk : Bulk
    operator : Operator
        Stiffness of the bodies.
    force : SharedVector
        Force of the current step, whose ghosts are exchanged.
    faults : list of Fault
    placed : mapping of str to Part
        Tables of the faults, with positions instead of points.
    cracks : CrackStep or None
    collisions : CollisionStep or None
    loads : Loads
    memory : dict of str to MemorySweep
        Sweeps over the elements of materials with memory that this rank has, by name of the body.
    viscosity : Viscosity or None
    attachments, mechanisms : list of Mechanism
    section : Section or None
        Bodies that repeat along strike; the mesh of this system is then a layer beside the interfaces.
    """

    case: CaseTables
    bulk: operators.Bulk
    operator: operators.Operator
    force: fem.SharedVector
    faults: list[Fault]
    placed: Mapping[str, Part]
    cracks: CrackStep | None
    collisions: CollisionStep | None
    loads: Loads
    memory: dict[str, MemorySweep]
    viscosity: Viscosity | None
    attachments: Sequence[Mechanism]
    mechanisms: list[Mechanism]
    section: Section | None

    @property
    def real(self) -> np.dtype:
        """Type of the velocities and forces of nodes."""
        return self.bulk.real

    @property
    @abstractmethod
    def memory_laws(self) -> dict[str, TracedMaterial]:
        """Traced formulas of the materials with memory, by name of the body."""

    @property
    @abstractmethod
    def points_of_cells(self) -> int:
        """Number of points of a cell that have a state of their own."""

    @property
    @abstractmethod
    def quadratic(self) -> bool:
        """True if the strain energy of the bodies is a quadratic form of the displacement."""

    @property
    @abstractmethod
    def copies(self) -> int:
        """2 if the bodies have a mirror image, whose energies count too, else 1."""

    @abstractmethod
    def in_steps(self, way: Way) -> Self:
        """Return this system with the contact methods for steps of one kind."""

    @abstractmethod
    def free_inverse_mass(self) -> np.ndarray:
        """Return the inverse mass of all degrees of freedom [1/kg], with sums of tied ones; zero if prescribed."""

    @abstractmethod
    def initial_state(self) -> State:
        """Return the state at the start."""

    @abstractmethod
    def initial_velocity(self) -> np.ndarray:
        """Return the velocity of all local degrees of freedom at the start [m/s]."""

    @abstractmethod
    def initial_slip_rate(self, fault: Fault) -> np.ndarray | None:
        """Return the slip rate at the start from the velocities of the bodies [m/s]."""

    @abstractmethod
    def internal_force(
        self, displacement: np.ndarray, at_rest: bool = False, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Return -K u of bodies and elastic supports, summed over ranks [N]."""

    @abstractmethod
    def energies(self, state: State, bulk: tuple[float, float] | None = None) -> dict[str, float]:
        """Return the energies over all ranks [J] at the time of the velocity."""

    @abstractmethod
    def bulk_energies(self, state: State) -> tuple[float, float]:
        """Return kinetic and strain energy of this rank [J]; collective."""

    @abstractmethod
    def strain_energy(self, displacement: np.ndarray) -> float:
        """Return the energy of the cells of this rank with large rotations, and of elastic supports [J]."""

    @abstractmethod
    def wave_speeds(self) -> WaveSpeeds:
        """Return the wave speeds of the body with the slowest S wave."""
