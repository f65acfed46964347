"""Smooth patch: shear traction that grows smoothly in a patch."""

from __future__ import annotations

import numpy as np

from ruptfx.input.profiles.places import Center, SmoothHalfWidth, distance
from ruptfx.input.units import Duration, Stress
from ruptfx.laws.nucleation import Nucleation


class SmoothPatch(Nucleation):
    """Smooth patch: extra F(r) G(t) with all derivatives continuous; r is the distance from the center.

    F = exp(r^2 / (r^2 - R^2)) for r < R = radius, else 0; G = exp((t - T)^2 / (t (t - 2 T))) for 0 < t < T = rise,
    then 1 (Source: SCEC/USGS benchmark TPV101 description).
    """

    extra: Stress
    """Final added shear traction at the center."""
    center: Center
    """Middle of the patch."""
    radius: SmoothHalfWidth
    """Radius of the patch."""
    rise: Duration
    """Time in which it is added."""

    def shear_traction(self, position: np.ndarray, time: float) -> np.ndarray:
        inside = np.minimum(distance(position, self.center) ** 2 / self.radius**2, 1 - 1e-12)
        shape = np.exp(inside / (inside - 1))
        return self.extra * self.growth(time) * shape

    def growth(self, time: float) -> float:
        """Return G(t)."""
        t = time / self.rise
        return 0.0 if t <= 0 else 1.0 if t >= 1 else float(np.exp((t - 1) ** 2 / (t * (t - 2))))
