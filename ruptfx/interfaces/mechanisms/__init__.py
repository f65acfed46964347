"""Mechanisms, one per file: forces on the bodies and constraints of their motion.

The model, checkpoints and the energy table ask all mechanisms of a case for their initial state, their fields and
their energies: the contract `PersistentState`. An explicit step is a sequence of phases, the methods of
`ExplicitPhases`: in each phase the stepper calls all mechanisms, in ascending `Acting.order`. Implicit steps ask those
that keep `ImplicitForce` for forces. None of them knows a mechanism by name, and no mechanism knows another one. Those
of this folder follow from the tables of a case; `ruptfx.interfaces.attachments` has those that a case chooses by their
kind.

Of the phases of an explicit step only `prepare` and `exchange` send messages. An error of one rank in a phase does not
end its step: the stepper keeps it, calls the other phases and mechanisms, as other ranks wait for their messages, and
raises it at the end of the step.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.spectrum import Springs as Springs  # of the contract: mechanisms and plug-ins import it from here
from ruptfx.input.fields import Energy

if TYPE_CHECKING:
    from ruptfx.bodies.operators import Damped, Inelastic
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.checks.table import Plan, Row
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System

Floats = NDArray[np.float64]
Rows = Mapping[str, np.ndarray]
"""Fields by name; values at all points in an order that no partition changes."""


@dataclass(frozen=True)
class StepEnd:
    """Trial displacement at the end of an implicit step.

    Attributes
    ----------
    displacement : ndarray, shape (nodes * components,)
        [m], complete at ghosts.
    dt : float
        Length of the step [s].
    weights : (float, float, float, float), optional
        alpha_m, alpha_f, gamma and beta of generalized-alpha; None in steps of equilibrium, without inertia.
    """

    displacement: Floats
    dt: float
    weights: tuple[float, float, float, float] | None = None


@dataclass(frozen=True)
class ElementStiffness:
    """Stiffness of elements beside that of the elastic bodies: it couples all nodes of an element.

    Attributes
    ----------
    nodes : ndarray of int, shape (m, n)
        Local nodes of the elements that this rank counts, each element once.
    moduli : ndarray, shape (m, ...)
        Numbers on which the matrices depend, symmetric in the last two axes where the matrices are.
    matrices : callable, (slice) -> ndarray, shape (k, n * components, n * components)
        Exact derivative of minus the force by the displacement [N/m] of some elements.
    """

    nodes: NDArray[np.int64]
    moduli: Floats
    matrices: Callable[[slice], Floats]


@dataclass(frozen=True)
class Reaction:
    """Forces of a mechanism on the bodies for a trial displacement.

    Attributes
    ----------
    nodes : ndarray of int, shape (n,)
        Local nodes, ghosts included.
    force : ndarray, shape (n, components)
        [N], complete at every node.
    stiffness : ndarray, shape (n, components, components) or (0, components, components)
        Exact derivative of minus the force by the displacement of the same node [N/m]; no rows without one.
    fields : dict of str to ndarray
        Fields of the mechanism at the end of the step.
    pairs : ndarray of int, shape (m, 2)
        Pairs of local nodes that this rank counts, among those of `Mechanism.coupled`; the same in all steps.
    between : callable, () -> ndarray, shape (m, components, components)
        Derivative of the force on the first node of a pair by the displacement of the second one [N/m]: the force
        depends on the difference of both displacements, and the second node has the opposite force. Called where
        the matrix of a step needs it.
    elements : callable, () -> list of ElementStiffness
        Called where the matrix of a step needs it.
    """

    nodes: NDArray[np.int64]
    force: Floats
    stiffness: Floats
    fields: Mapping[str, Floats]
    pairs: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    between: Callable[[], Floats] = field(default=lambda: np.zeros((0, 1, 1)))
    elements: Callable[[], list[ElementStiffness]] = field(default=list)


class Acting:
    """Base of the contracts of a mechanism, which holds the model.

    Attributes
    ----------
    order : int
        Facets (0) come first: they find the force zero. Prescribed motion (50) comes before contact (60), which reads
        it; ties (80) and components that move as one (90) equalise what contact did to one of their nodes.
    """

    order: ClassVar[int] = 55

    def __init__(self, model: System) -> None:
        self.model = model


class PersistentState(Acting):
    """The contract of what lasts beyond a step: fields, energies, checkpoints, and rows of the pre-flight check.

    Attributes
    ----------
    energies : tuple of Energy
        Columns of the energy table that only cases with this mechanism have.
    """

    energies: ClassVar[tuple[Energy, ...]] = ()

    def begin(self, state: State) -> None:
        """Add the fields and energies of this mechanism to the state at the start of a run."""

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        """Add the energies that steps have not accumulated, at the time of the velocity [J].

        Parameters
        ----------
        energies : dict of str to float
            Columns of the energy table, of this rank.
        """

    def close_energies(self, state: State, energies: dict[str, float]) -> None:
        """Set energies that follow from those which the bodies and all mechanisms have added [J]."""

    def saved(self, state: State) -> Mapping[str, Rows]:
        """Return all fields that a checkpoint needs, by group and name, complete on rank 0; collective."""
        return {}

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        """Fill the fields from a checkpoint; `read` returns the rows of "group/name".

        Raises
        ------
        KeyError
            A checkpoint without one of them.
        """

    def springs(self) -> list[Springs]:
        """Return its springs, which shorten the stable time step."""
        return []

    def check(self, plan: Plan) -> Iterator[Row]:
        """Yield the rows of `ruptfx check` on this mechanism."""
        return iter(())

    def add_resistance(self, state: State, force: Floats) -> None:
        """Add the forces of which the reactions at edges are the sums with those of the elements, at a record [N]."""

    def counted(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the local nodes of an edge, shape (counted,), without those that stand for others among them."""
        return nodes


class ExplicitPhases(Acting):
    """The contract of explicit steps; a phase without forces or constraints does nothing.

    Attributes
    ----------
    rounds_as_kernel : bool
        Whether stepped nodes must be rounded as the bulk kernel rounds the others, so that results are bitwise the same
        on any number of ranks.
    damped : Damped, optional
        Viscous damping of all elements, which the bulk kernel computes in its sweep.
    inelastic : Inelastic, optional
        Inelastic stress of materials with memory, which the bulk kernel computes in its sweep.
    """

    adjoint: ClassVar[bool] = False
    """Whether the sweeps of `ruptfx.many_runs.adjoint` contain it."""
    local_steps: ClassVar[bool] = False
    """Whether it acts in local time steps: in every substep, with the forces of elements at some nodes as impulses."""
    rounds_as_kernel: bool = False
    damped: Damped | None = None
    inelastic: Inelastic | None = None

    def nodes(self) -> NDArray[np.bool_]:
        """Return a mask of the nodes that the stepper advances instead of the bulk kernel, shape (nodes,)."""
        return np.zeros(self.model.nodes, dtype=bool)

    def smooth_nodes(self) -> NDArray[np.bool_]:
        """Return a mask of the nodes whose elements must act in every substep of local time steps, shape (nodes,)."""
        return self.nodes()

    def obstacle_to_substeps(self) -> str:
        """Return key, value and remedy of a message where it acts in equal steps only; empty with `local_steps`."""
        equal = "a part of this case acts in equal steps only; use stepper.kind = 'leapfrog'"
        return "" if self.local_steps else f"stepper.kind = 'local_leapfrog': {equal}"

    def bind(self, stepped: SteppedNodes) -> None:
        """Prepare arrays for steps of one size."""

    def prepare(self, state: State, kick: Kick) -> None:
        """Update geometry and connectivity before any force is computed; collective, so errors are of all ranks."""

    def add_first(self, state: State, kick: Kick) -> None:
        """Add forces at the nodes this rank owns, before those of the elements, in an order that no partition changes.

        They are not derivatives of the strain energy of the bodies.
        """

    def add_with_elements(self, state: State, kick: Kick) -> None:
        """Add forces of the elements of this rank; they are summed over ranks afterwards."""

    def add_internal(self, state: State, kick: Kick) -> None:
        """Add forces that derive from the strain energy, complete at every local node."""

    def outside_energy(self) -> list[tuple[NDArray[np.int64] | slice, Floats]]:
        """Return internal forces that do not derive from the strain energy: degrees of freedom, values [N]."""
        return []

    def add_external(self, state: State, kick: Kick) -> None:
        """Add applied forces, complete at every local node."""

    def combine(self, state: State, kick: Kick) -> None:
        """Give nodes that move together the sum of their forces."""

    def before_kick(self, state: State, kick: Kick) -> None:
        """Read the velocities before the forces act on them."""

    def after_kick(self, state: State, kick: Kick) -> None:
        """Correct the velocities after all other forces have acted: prescribed motion, contact, ties.

        Raises
        ------
        RuptfxError
            On the rank that owns the failing point.
        """

    def exchange(self, state: State, kick: Kick) -> None:
        """Send velocities that `after_kick` has corrected to other ranks, before the next mechanism; collective.

        It is called also where `after_kick` has raised.
        """

    def account(self, state: State, kick: Kick) -> None:
        """Add the work and the losses of the step to `state.energy`; the new velocities are final."""

    def started(self, state: State, dt: float) -> None:
        """Correct the work of step 0, in which bodies reach v from rest in half a step."""


class ImplicitForce(Acting):
    """The contract of forces at the end of implicit steps, beside those of bodies, boundaries and faults."""

    def coupled(self) -> NDArray[np.int64]:
        """Return pairs of local nodes that its stiffness couples in implicit steps, shape (pairs, 2)."""
        return np.zeros((0, 2), dtype=np.int64)

    def respond(self, state: State, end: StepEnd) -> Reaction:
        """Return its forces at the end of an implicit step, with `state` unchanged; collective."""
        raise NotImplementedError

    def force_of(self, state: State) -> Reaction:
        """Return its forces in a state between implicit steps."""
        raise NotImplementedError

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        """Copy its fields to the state and count its losses; the displacement is that at the start of the step.

        Raises
        ------
        RuptfxError
            On all ranks.
        """

    def step_error(self, state: State, reaction: Reaction) -> float:
        """Return its error in a step over what is tolerated, largest of this rank; steps of variable length heed it.

        They do not accept an error above 1 in their smallest step either.
        """
        return 0.0

    def fastest(self, state: State) -> float:
        """Return the largest rate of slip or opening against its resistance [m/s], of this rank."""
        return 0.0


class Mechanism(PersistentState, ExplicitPhases):
    """A mechanism of a model; those that act in implicit steps keep the contract `ImplicitForce`, too."""

    @classmethod
    def present(cls, model: System) -> bool:
        """Return whether the model has this mechanism."""
        return True


def responding(mechanisms: Iterable[Mechanism]) -> list[ImplicitForce]:
    """Return the mechanisms that act in implicit steps."""
    return [each for each in mechanisms if isinstance(each, ImplicitForce)]


@cache
def kinds() -> tuple[type[Mechanism], ...]:
    """Return the mechanisms in the files of this folder, in calling order."""
    files = [each.name for each in pkgutil.iter_modules(__path__) if not each.name.startswith("_")]
    modules = [import_module(f"{__name__}.{name}") for name in files]
    own = [each for module in modules for each in vars(module).values() if isinstance(each, type)
           and each.__module__ == module.__name__]  # fmt: skip
    items = [each for each in own if issubclass(each, Mechanism)]
    return tuple(sorted(items, key=lambda each: (each.order, each.__name__)))


def mechanisms_of(model: System) -> list[Mechanism]:
    """Return the mechanisms that a model has, in calling order."""
    items = [*(kind(model) for kind in kinds() if kind.present(model)), *model.attachments]
    return sorted(items, key=lambda each: (each.order, type(each).__name__))
