"""Ground motion at the points of a grid of receivers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.results.record import Data


def speeds_of(data: Data) -> np.ndarray:
    """Return the length of the velocity at every time and point of a grid [m/s], shape (times, points)."""
    components = [data[name].values for name in data if str(name).startswith("velocity_")]
    return np.asarray(np.sqrt(np.sum(np.square(components), axis=0)))
