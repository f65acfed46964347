"""When it is found again what the points of an interface face; what a run needs to go on from there."""

from __future__ import annotations

import numpy as np

from ruptfx.fault import Fault
from ruptfx.sliding.interface import SlidingInterface
from ruptfx.state import State


class Follower:
    """Lets the geometry of an interface follow the motion; called at the beginning of every step.

    What it was last made from is in the state, the displacement as a nodal field and the tangential jump as a field of
    the fault: a run that goes on from a checkpoint makes the same geometry, to the last bit.

    Parameters
    ----------
    fault : Fault
        Its interface slides.
    """

    def __init__(self, fault: Fault) -> None:
        face = fault.interface
        assert isinstance(face, SlidingInterface)
        self._name, self._face = fault.name, face
        self._state: State | None = None
        self._room = 0.0  # that points have left at least, before one has slid far enough [m]

    def __call__(self, state: State) -> None:
        """Find again what points face if one has slid far enough, or if one that faced nothing may do so now."""
        face, field = self._face, f"followed_{self._name}"
        if field not in state.fields:
            state.fields[field] = np.zeros_like(state.displacement)
        followed = state.fields[field]
        if not len(face.plus):
            return
        slip_then = state.faults[self._name]["slip_followed"]
        if self._state is not state:
            self._state = state
            face.geometry.follow(followed[face.dofs].reshape(-1, 2), slip_then)
            self._room = 0.0
        self._room -= face.geometry.slides
        face.geometry.slides = np.inf
        if self._room > 0 and face.covered.all():
            return
        slip = face.jump(state.displacement)[:, 1]
        farthest = float(np.abs(slip - slip_then).max())
        self._room = face.limit - farthest
        slid = farthest > face.limit
        moved = not face.covered.all() and np.abs((state.displacement - followed)[face.dofs]).max() > face.near
        if slid or moved:
            followed[face.dofs], slip_then[:] = state.displacement[face.dofs], slip
            face.geometry.follow(followed[face.dofs].reshape(-1, 2), slip)
