"""Boundaries and loads, one kind per file; the file name is the `kind` of an entry of ``[[boundaries]]``.

Displacements are measured from the initial state, which is in equilibrium; a boundary adds to its initial load. Edges
that are not named are free to move under their initial load. `ruptfx.bodies.boundaries.loading.Loads` sums the actions
of all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries.histories import Sampled, Samples
from ruptfx.input.schema import Alternative, Unit, alternative
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads
    from ruptfx.bodies.space.edges import Edge

Component = Literal["x", "y", "z"]
Range = Annotated[list[float], Field(min_length=2, max_length=2), Unit("m")]


@dataclass(frozen=True)
class PrescribedMotion:
    """Prescribed motion of some degrees of freedom.

    Attributes
    ----------
    dofs : ndarray of int, shape (n,)
        Local ones.
    displacement, velocity, acceleration : callable, time -> float or ndarray of shape (n,)
        Motion since time zero [m], [m/s], [m/s2]: one number for all degrees of freedom, or an array.
    """

    dofs: np.ndarray
    displacement: Callable[[float], float | np.ndarray]
    velocity: Callable[[float], float | np.ndarray]
    acceleration: Callable[[float], float | np.ndarray]


@dataclass(frozen=True)
class Force:
    """Nodal forces and their common factor in time.

    Attributes
    ----------
    dofs : ndarray of int, shape (n,)
        Local ones.
    values : ndarray, shape (n,)
        Complete at every local node [N].
    factor : callable, time -> float or ndarray of shape (n,)
    """

    dofs: np.ndarray
    values: np.ndarray
    factor: Callable[[float], float | np.ndarray]

    @classmethod
    def of(cls, nodal: np.ndarray, factor: Callable[[float], float | np.ndarray]) -> Force:
        """Return the force of a vector over all local degrees of freedom [N] times a factor."""
        dofs = np.flatnonzero(nodal)
        return cls(dofs, nodal[dofs], factor)


@dataclass(frozen=True)
class Support:
    """Springs at single nodes that resist their displacement.

    Attributes
    ----------
    nodes : ndarray of int, shape (n,)
        Local ones.
    stiffness : ndarray, shape (n, components, components)
        Complete at every local node [N/m], symmetric.
    """

    nodes: np.ndarray
    stiffness: np.ndarray


@dataclass(frozen=True)
class Action:
    """Terms that a boundary adds to the equation of motion; None for those it does not have.

    Attributes
    ----------
    motion : PrescribedMotion, optional
    force : Force, optional
    dashpot : ndarray, shape (nodes * components,), optional
        Damping force per velocity, complete at every local node [N s/m].
    support : Support, optional
    """

    motion: PrescribedMotion | None = None
    force: Force | None = None
    dashpot: np.ndarray | None = None
    support: Support | None = None


class Boundary(Alternative):
    """The contract of a boundary, which may also act inside of the bodies."""

    example: ClassVar[str] = ""
    """Entry of a case of two plates in plane stress, each 12 mm long and 4 mm high."""
    source: ClassVar[str] = ""
    """Publication of the method."""
    needs_with: ClassVar[dict[str, str]] = {"tied_edges": "ties", "waves": "inertia"}
    waves: ClassVar[bool] = False
    """Whether it acts on waves only, and needs a stepper that computes them."""
    acts: ClassVar[bool] = True
    """Whether it adds anything to the equation of motion."""
    amounts: ClassVar[tuple[str, ...]] = ()
    """Fields of amplitude and duration, with a `ramp` among them; a stage of loading may change them smoothly."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        """Refuse fields that do not fit a plane, in which displacement has these components (``xy``, ``z`` or ``xyz``).

        Raises
        ------
        ValueError
            Names the key, the value and the remedy.
        """

    @property
    def driven_edge(self) -> str | None:
        """Edge with prescribed motion, None if there is none."""
        return None

    @property
    def tied_edges(self) -> tuple[str, str] | None:
        """Two edges whose nodes have the same motion, None if there are none."""
        return None

    @property
    def largest_speed(self) -> float:
        """Largest prescribed speed [m/s]."""
        return 0.0

    @property
    def samples(self) -> Samples | None:
        """Samples in time that prescribe the load, None if there are none."""
        history = getattr(self, "history", None)
        return history.samples if isinstance(history, Sampled) else None

    def in_place_of(self, other: Boundary) -> bool:
        """Return whether boundaries differ by amplitudes only, so that the next stage continues from the last value."""
        if type(self) is not type(other) or not self.amounts:
            return False
        kept = set(type(self).model_fields) - set(self.amounts)
        return all(getattr(self, name) == getattr(other, name) for name in kept)

    def act(self, loads: Loads, key: str) -> Action:
        """Return the action on the bodies of `loads.model`, whose mass and interfaces are known; collective.

        Raises
        ------
        RuptfxError
            On all ranks, naming the key: an edge or a place that is not there.
        """
        raise NotImplementedError


class EdgeBoundary(Boundary):
    """A boundary on a named edge."""

    edge: str
    """``body.side``, for example ``upper.left``."""

    def act(self, loads: Loads, key: str) -> Action:
        return self.act_on(loads.edge(self.edge, f"{key}.edge"), key)

    def act_on(self, edge: Edge, key: str) -> Action:
        """Return the action on an edge; collective.

        Raises
        ------
        RuptfxError
            On all ranks.
        """
        raise NotImplementedError


def check_component(key: str, value: str, plane: Plane, components: str) -> None:
    """Refuse a direction in which the bodies cannot move.

    Raises
    ------
    ValueError
    """
    if value not in components:
        raise ValueError(f"{key} = '{value}': plane = '{plane}' moves in {components} only; use one of these")


def check_vector(key: str, value: list[float], components: str) -> None:
    """Refuse a vector with the wrong number of components.

    Raises
    ------
    ValueError
    """
    if len(value) != len(components):
        raise ValueError(f"{key}: {len(components)} components are needed ({components}), {len(value)} given")


if TYPE_CHECKING:
    AnyBoundary = Boundary
else:
    AnyBoundary = alternative("ruptfx.bodies.boundaries")

SHARED = ("histories", "loading")
"""Files of this folder that are no kinds."""
