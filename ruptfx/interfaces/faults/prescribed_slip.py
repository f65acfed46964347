"""Slip that is prescribed at points of an interface, in place of friction.

A step subtracts Z V from the trial traction, with V the slip rate that brings the slip to its prescribed value at the
end of the step, and holds the point at what remains: traction follows from slip, and contact, energies, records and
implicit tangents are those of a point that sticks. Both sides stay together there, whatever the normal stress is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface

Course = Callable[[float], np.ndarray]
"""Values at a time [s], shape (n, tangents)."""


@dataclass(frozen=True)
class History:
    """A history of slip at the points of an interface.

    Attributes
    ----------
    held : ndarray of bool, shape (n,)
        Points at which it prescribes slip.
    slip, rate : callable
        Slip [m] and slip rate [m/s] of all points at a time, in the directions of the tangents.
    jump : ndarray, shape (n,)
        Largest sudden change of the slip rate [m/s].
    note : str
        What the history says of itself in `ruptfx check`.
    """

    held: np.ndarray
    slip: Course
    rate: Course
    jump: np.ndarray
    note: str = ""


@dataclass(frozen=True)
class PrescribedSlip:
    """Sum of the histories of an interface.

    Attributes
    ----------
    histories : sequence of History
    everywhere : bool
        Whether points that no history reaches are held without slip, as the interface has no friction law.
    """

    histories: Sequence[History]
    everywhere: bool = False

    @cached_property
    def held(self) -> np.ndarray:
        """Mask of the points with prescribed slip, shape (n,)."""
        held = np.any([each.held for each in self.histories], axis=0)
        return np.asarray(held | self.everywhere)

    @cached_property
    def jump(self) -> np.ndarray:
        """Bound of the sudden changes of the slip rate [m/s], shape (n,)."""
        return np.asarray(sum(each.held * each.jump for each in self.histories))

    def slip(self, time: float) -> np.ndarray:
        """Return the slip at a time [s] in m, shape (n, tangents); zero where none is prescribed."""
        return np.asarray(sum(each.held[:, None] * each.slip(time) for each in self.histories))

    def rate(self, time: float) -> np.ndarray:
        """Return the slip rate at a time [s] in m/s, shape (n, tangents)."""
        return np.asarray(sum(each.held[:, None] * each.rate(time) for each in self.histories))

    def power(self, face: Interface, density: np.ndarray) -> float:
        """Return the part of a power of slip [W/m2], shape (n,), at points of this rank with prescribed slip [W]."""
        return float((face.owned * face.weight * self.held) @ density)

    def mean_rate(self, end: float, begun: np.ndarray, duration: float) -> np.ndarray:
        """Return the slip rate of a step, shape (n, tangents) [m/s]; zero where no slip is prescribed.

        Parameters
        ----------
        end : float
            Time at which the slip is that of the histories [s].
        begun : ndarray, shape (n, tangents)
            Slip at the beginning of the step [m].
        duration : float
            [s]; a step without one keeps its rates.
        """
        if duration <= 0:
            return np.zeros_like(begun)
        return np.asarray(self.held[:, None] * (self.slip(end) - begun) / duration)
