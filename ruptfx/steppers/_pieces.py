"""Leapfrog steps of bodies whose facets are rigid until their strength: the corners of a piece move as one.

Mass, damping and force of a piece are those of its corners together, so that all of them get the same velocity to the
last bit. As facets are inserted, pieces fall apart, and the sums of the new ones are made.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.cracks._rigid import RigidCracks
    from ruptfx.model import Model
    from ruptfx.operators import Damped
    from ruptfx.state import State

Renew = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]
"""Takes over degrees of freedom, and of each mass [kg], dashpot [N s/m] and whether its motion is prescribed."""


class Pieces:
    """What leapfrog does with the corners of a model with rigid cracks.

    Parameters
    ----------
    model : Model
    cracks : RigidCracks
    mass, dashpot : ndarray, shape (nodes * 2,)
        Of every corner alone [kg, N s/m].
    renew : callable
        Called with all degrees of freedom that have changed.
    once : ndarray, shape (nodes * 2,)
        Kept as 1 where this rank counts a piece, else 0.

    Attributes
    ----------
    held : ndarray of int
        Degrees of freedom that `advance` leaves alone: at vertices that are in pieces or on which something acts, and
        of corners whose star is not here.
    """

    def __init__(
        self, model: Model, cracks: RigidCracks, mass: np.ndarray, dashpot: np.ndarray, renew: Renew, once: np.ndarray
    ) -> None:
        self._model, self._rigid, self._renew, self._once = model, cracks, renew, once
        self._own = mass.copy(), dashpot.copy(), model.loads.prescribed.astype(float)
        self._together = tuple(np.empty_like(values) for values in self._own)
        self._adopted: State | None = None
        self._followers = self._leaders = np.zeros(0, np.int64)  # degrees of freedom that move as driven ones do
        acting = model.loads.acting.reshape(-1, 2).any(axis=1)
        acting |= model.case.damping.mass > 0  # its work is summed with that of dashpots
        for fault in model.faults:
            acting[fault.interface.nodes] = True
        for tied in (model.layout.kept, model.layout.copies):
            acting[tied] = True
        self._acting = acting
        self.held = np.zeros(0, np.int64)

    def part(self, state: State) -> None:
        """Insert the facets whose strength is reached, before a step."""
        if state is not self._adopted:
            self._rigid.adopt(state.cracks)
            self._sum(None)
            self._adopted = state
        found = self._rigid.grow(state, self._model.mass)
        if len(found):
            self._sum(found)

    def join(self, force: np.ndarray) -> None:
        """Give the corners of every held piece the force on all of them [N]."""
        self._rigid.total(force, force, self._rigid.held)

    def advance(self, state: State, dt: float, keep: np.ndarray, push: np.ndarray, damped: Damped | None) -> None:
        """Move the vertices on that are not held, and what `damped` takes of them; as of `RigidCracks.advance`."""
        self._rigid.advance(state, dt, keep, push, damped)

    def hold(self, state: State, dt: float, kick: float, since: float, push: np.ndarray, before: np.ndarray) -> None:
        """Give velocities what inserted facets make of them; arguments as of `RigidCracks.hold`."""
        state.velocity[self._followers] = state.velocity[self._leaders]
        self._rigid.hold(state, dt, kick, since, push, before)
        self._model.layout.take_from_owners(state.velocity)

    def _sum(self, vertices: np.ndarray | None) -> None:
        """Sum what pieces have, at all vertices or at some."""
        rigid = self._rigid
        if vertices is None:
            nodes = np.arange(self._model.nodes)
            for own, together in zip(self._own, self._together, strict=True):
                together[:] = own  # also of corners whose star is not here
        else:
            nodes = rigid.corners_at(vertices)
        for own, together in zip(self._own, self._together, strict=True):
            rigid.total(own, together, vertices)
        dofs = (2 * nodes[:, None] + np.arange(2)).ravel()
        mass, dashpot, driven = (together[dofs] for together in self._together)
        self._renew(dofs, mass, dashpot, driven > 0)
        first = (rigid.leader[nodes] == nodes) & (nodes < self._model.owned_nodes)
        self._once[dofs] = np.repeat(first.astype(float), 2)
        if vertices is None or driven.any():
            self._follow()
        self.held = (2 * rigid.hold_vertices(self._acting)[:, None] + np.arange(2)).ravel()

    def _follow(self) -> None:
        """Find what hangs on driven corners; where several are driven, the last motion counts, as it does at nodes."""
        leader = (2 * self._rigid.leader.astype(np.int64)[:, None] + np.arange(2)).ravel()
        source = np.full(len(leader), -1)
        for motion in self._model.loads.motions:
            source[leader[motion.dofs]] = motion.dofs
        source = source[leader]
        self._followers = np.flatnonzero((source >= 0) & (source != np.arange(len(source))))
        self._leaders = source[self._followers]
