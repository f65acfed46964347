"""All boundaries of a case together, as used by steppers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.boundaries import Action, Boundary, Force, PrescribedMotion, Support
from ruptfx.bodies.space import axisymmetry
from ruptfx.bodies.space.edges import Edge
from ruptfx.bodies.space.inside import Inside
from ruptfx.input.schema import CaseError
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation


class Loads:
    """Sum of all boundary actions over the local degrees of freedom.

    Parameters
    ----------
    key : str
        Of the case, for messages.

    Attributes
    ----------
    model : Discretisation
    motions : list of PrescribedMotion
    forces : list of Force
    ended : list of Force
        Forces of the previous stage, which still act in explicit steps around its end.
    dashpot : ndarray, shape (nodes * components,)
        Damping force per velocity of boundaries and attachments [N s/m].
    supports : list of Support
    loading : list of int
        Boundaries with forces or dashpots, by their place in the list.
    lasting_forces : list of Force
        Forces of the boundaries without dashpots of their own, which let waves pass.
    start, end : float
        Times between which they act [s].

    Raises
    ------
    RuptfxError
        On all ranks, if a boundary does not fit the bodies.
    """

    start, end = 0.0, np.inf

    def __init__(self, model: Discretisation, boundaries: Sequence[Boundary], key: str = "boundaries") -> None:
        self.model = model
        self.dashpot = np.zeros(model.nodes * model.components)
        self.loading: list[int] = []
        self.lasting_forces: list[Force] = []
        self._acts: list[tuple[Boundary, list[Action]]] = []
        reach: list[list[tuple[str, np.ndarray]]] = []
        for number, each in enumerate(boundaries):
            result = self.act(each, f"{key}.{number}")
            reach.append(self._reach(result[0]))
            self._acts.append((each, [self._without_dashpot(action, number) for action in result]))
        actions = [action for _, result in self._acts for action in result]
        self.motions = [action.motion for action in actions if action.motion is not None]
        if model.plane == "axisymmetric":
            self.motions.append(_resting(2 * np.flatnonzero(axisymmetry.on_axis(model.coordinates)) + 1))
        self.forces = [action.force for action in actions if action.force is not None]
        self.ended: list[Force] = []
        self.supports: list[Support] = [action.support for action in actions if action.support is not None]
        layout, prescribed = model.layout, self.prescribed
        of_nodes = prescribed.reshape(model.nodes, -1)
        one_only = (of_nodes[layout.kept] != of_nodes[layout.copies]).any(axis=1)
        error = None
        if np.any(one_only):
            x = ", ".join(f"{value:.6g}" for value in model.coordinates[layout.kept[np.argmax(one_only)]])
            error = CaseError(f"boundaries: one of two nodes that are tied is driven, at ({x}) m; drive both or none")
        parallel.raise_on_all(model.comm, error)
        for number in range(len(self._acts)):
            self._refuse_without_effect(key, number, prescribed, reach[number])

    def _without_dashpot(self, action: Action, number: int) -> Action:
        """Add the dashpots and forces of an action to those of all, and return it without dashpots.

        They are vectors over all nodes, of which one for each boundary would be the largest part of the memory.
        """
        if action.force is not None or action.dashpot is not None:
            self.loading.append(number)
        if action.force is not None and action.dashpot is None:
            self.lasting_forces.append(action.force)
        if action.dashpot is None:
            return action
        self.add_dashpot(action.dashpot)
        return replace(action, dashpot=None)

    def add_dashpot(self, dashpot: np.ndarray) -> None:
        """Add a damping force per velocity, complete at every local node [N s/m], shape (nodes * components,)."""
        self.dashpot += dashpot
        # Contact solves for normal and shear traction one after the other: its nodes need the same inertia along both.
        of_nodes, oblique = self.dashpot.reshape(self.model.nodes, -1), self.model.oblique
        of_nodes[oblique] = of_nodes[oblique].mean(axis=1, keepdims=True)

    def _refuse_without_effect(
        self, key: str, number: int, prescribed: np.ndarray, reach: list[tuple[str, np.ndarray]]
    ) -> None:
        """Refuse a boundary that drives degrees of freedom twice, or acts only on driven ones; collective.

        Parameters
        ----------
        key : str
            Of the list of boundaries.
        prescribed : ndarray of bool, shape (nodes * components,)
        reach : list of (str, ndarray of int)
            From `_reach`.

        Raises
        ------
        CaseError
            On all ranks.
        """
        boundary, (action, *_) = self._acts[number]
        place = f"{key}.{number}"
        if action.motion is not None:
            for earlier, (other, (before, *_)) in enumerate(self._acts[:number]):
                if before.motion is not None and other.driven_edge == boundary.driven_edge:
                    twice = np.intersect1d(action.motion.dofs, before.motion.dofs)
                    if parallel.anywhere(self.model.comm, self._has_facet(twice)):
                        raise CaseError(
                            f"{place}.edge = '{boundary.driven_edge}': {key}.{earlier} drives the same part of it in "
                            "the same direction; remove one of them, or give each its x_range or y_range"
                        )
        for what, dofs in reach:
            free = dofs[~prescribed[dofs]]
            count, free_dofs = parallel.total(self.model.comm, [len(dofs), len(free)])
            if count and not free_dofs:
                raise CaseError(
                    f"{place}.kind = '{boundary.kind()}': without effect{what}, for all that it acts on is driven; "
                    "leave that component out, or remove this entry or what drives"
                )

    def _reach(self, action: Action) -> list[tuple[str, np.ndarray]]:
        """Return the local degrees of freedom of an action, by component as text; those of dashpots together."""
        dofs, c = [], self.model.components
        if action.force is not None:
            size = np.abs(action.force.values)  # shape functions are zero at other nodes to rounding
            dofs.append(action.force.dofs[size > 1e-9 * parallel.largest(self.model.comm, size.max(initial=0.0))])
        if action.support is not None:
            stiff = np.any(action.support.stiffness, axis=2)
            dofs.append((action.support.nodes[:, None] * c + np.arange(c))[stiff])
        if action.dashpot is not None:
            return [("", np.concatenate([*dofs, np.flatnonzero(action.dashpot)]))]
        names = {1: "z", 2: "xy", 3: "xyz"}[c]
        return [(f" in {name}", each[each % c == i]) for each in dofs for i, name in enumerate(names)]

    def _has_facet(self, dofs: np.ndarray) -> bool:
        """Return whether degrees of freedom are those of a facet at least, and not of its ends only."""
        model = self.model
        marked = np.zeros(model.nodes, dtype=bool)
        marked[dofs // model.components] = True
        of_end = 1 if model.mesh.geometry.dim == 2 else model.order + 1
        return bool(np.any(marked[model.space.dofmap.list].sum(axis=1) > of_end))

    def act(self, boundary: Boundary, key: str) -> list[Action]:
        """Return the actions of a boundary."""
        return [boundary.act(self, key)]

    def actions_of(self, boundary: Boundary) -> list[Action]:
        """Return the actions of the boundary here that differs from the given one in its amounts only."""
        return next((result for other, result in self._acts if other.in_place_of(boundary)), [])

    def edge(self, name: str, key: str) -> Edge:
        """Return an edge of the bodies; `key` of the case is for messages.

        Raises
        ------
        RuptfxError
            No such edge.
        """
        return Edge(self.model, name, key)

    def inside(self, point: Sequence[float], body: str | None, key: str) -> Inside:
        """Return a point of the bodies [m]; `key` of the case is for messages.

        Raises
        ------
        CaseError
            On all ranks: no such point, or several bodies contain it and none is named.
        """
        return Inside(self.model, point, body, key)

    @property
    def prescribed(self) -> np.ndarray:
        """True for every degree of freedom whose motion is prescribed."""
        prescribed = np.zeros(len(self.dashpot), dtype=bool)
        for motion in self.motions:
            prescribed[motion.dofs] = True
        return prescribed

    @property
    def acting(self) -> np.ndarray:
        """True for every degree of freedom on which a boundary acts."""
        acting = (self.dashpot != 0) | self.prescribed
        for force in (*self.forces, *self.ended):
            acting[force.dofs] = True
        for support in self.supports:
            acting.reshape(-1, self.model.components)[support.nodes] = True
        return acting

    def drive(self, velocity: np.ndarray, time: float) -> None:
        """Set the velocity of driven edges at a time [s], in place."""
        for motion in self.motions:
            velocity[motion.dofs] = motion.velocity(time)

    def accelerate(self, acceleration: np.ndarray, time: float) -> None:
        """Set the acceleration of driven edges at a time [s], in place."""
        for motion in self.motions:
            acceleration[motion.dofs] = motion.acceleration(time)

    def shortened(self, time: float, dt: float) -> float:
        """Return a step from a time on [s], or the remaining time of these loads, up to rounding."""
        until_end = self.end - time
        return dt if dt <= (1 + 1e-9) * until_end else until_end

    def moved(self, displacement: np.ndarray, start: float, end: float) -> np.ndarray:
        """Return a displacement at time `start` with driven edges at their position at time `end` [m]."""
        moved = displacement.copy()
        for motion in self.motions:
            moved[motion.dofs] = displacement[motion.dofs] + motion.displacement(end) - motion.displacement(start)
        return moved

    def force(self, time: float) -> np.ndarray:
        """Return the nodal force at a time [s], shape (nodes * components,) [N]."""
        total = np.zeros(len(self.dashpot))
        for force in self.forces:
            total[force.dofs] += force.factor(time) * force.values
        return total

    def mean_factors(self, time: float, since: float) -> list[float | np.ndarray]:
        """Return factors of `forces` and `ended` in an explicit step at a time, `since` after the previous one [s]."""
        return [force.factor(time) for force in self.forces]

    def add_support_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """Add the forces of elastic supports to nodal forces [N], in place."""
        u, total = displacement.reshape(-1, self.model.components), force.reshape(-1, self.model.components)
        for support in self.supports:
            total[support.nodes] -= np.einsum("nij,nj->ni", support.stiffness, u[support.nodes])


def _resting(dofs: np.ndarray) -> PrescribedMotion:
    """Return a zero motion, for the radial displacement on an axis of revolution."""

    def zero(time: float) -> float:
        return 0.0

    return PrescribedMotion(dofs, zero, zero, zero)
