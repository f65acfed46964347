"""Overstress: shear traction present from the start."""

from __future__ import annotations

import numpy as np

from ruptfx.input.profiles import evaluate
from ruptfx.input.units import VaryingStress
from ruptfx.laws.nucleation import Nucleation


class Overstress(Nucleation):
    """Overstress: shear traction added to the initial one from the start, usually above the strength in a patch."""

    extra: VaryingStress
    """Added shear traction, mostly a `boxcar`."""

    def shear_traction(self, position: np.ndarray, time: float) -> np.ndarray:
        return evaluate(self.extra, position)
