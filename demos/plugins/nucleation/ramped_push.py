"""Shear traction that grows linearly."""

import numpy as np

from ruptfx.plugin import Duration, Nucleation, VaryingStress, evaluate


class RampedPush(Nucleation):
    """Shear traction that grows linearly."""

    extra: VaryingStress
    """Shear traction at the end."""
    rise: Duration
    """Time until the end."""

    def shear_traction(self, position: np.ndarray, time: float) -> np.ndarray:
        return evaluate(self.extra, position) * min(time / self.rise, 1.0)
