"""Displacement at points of linear bodies, from their loads and from the slip of their interfaces.

With interfaces that are stuck with the stiffness kappa, J the jump, W the weights of its points and T - T_0 the
tractions, bodies are in equilibrium with A u = f + J' W (kappa g - (T - T_0)). A point p of the bodies has the
displacement p' u; one solution z = A^-1 p gives its weights z' J' W for any slip and time, as A is symmetric.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ruptfx.bodies.space.discretisation import Discretisation
from ruptfx.bodies.space.inside import Inside

Array = np.ndarray
PART = 1e-6  # of the duration, over which loads are compared with themselves for their rate


@dataclass(frozen=True)
class Receivers:
    """Points of the bodies, and how their displacement follows from loads and slip.

    Attributes
    ----------
    by_loads : callable, (time) -> ndarray of shape (receivers, components)
        Displacement with interfaces that do not slip [m].
    by_slip : callable, (slip) -> ndarray of shape (receivers, components)
        Displacement by slip [m], linear, from slip of shape (points, tangents) [m].
    duration : float
        Of the run [s].
    """

    by_loads: Callable[[float], Array]
    by_slip: Callable[[Array], Array]
    duration: float

    def displacement(self, time: float, slip: Array) -> Array:
        """Return the displacement [m], shape (receivers, components), of slip at a time."""
        return np.asarray(self.by_loads(time) + self.by_slip(slip))

    def velocity(self, time: float, slip_rate: Array) -> Array:
        """Return the velocity [m/s], shape (receivers, components), of slip rates at a time."""
        step = PART * self.duration
        first = max(time - 0.5 * step, 0.0)
        by_loads = (self.by_loads(first + step) - self.by_loads(first)) / step
        return np.asarray(by_loads + self.by_slip(slip_rate))


def rows_of(model: Discretisation, places: Sequence[Inside]) -> Array:
    """Return p of every component of places, shape (places, components, degrees of freedom)."""
    units = np.eye(model.components).tolist()
    return np.array([[place.force(unit) for unit in units] for place in places])
