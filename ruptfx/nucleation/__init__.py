"""Ways to start a rupture, one per file; the file name is the `kind` of an entry of ``[[faults.NAME.nucleation]]``.

A nucleation either adds shear traction to the initial stress, as a function of place and time, or weakens friction.
The state of the law is that of the stress without it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.friction import FrictionLaw
from ruptfx.schema import Alternative, alternative


class Nucleation(Alternative):
    """The contract of a nucleation."""

    def shear_traction(self, position: np.ndarray, time: float) -> np.ndarray:
        """Shear traction [Pa] added to the initial one along the first tangent.

        Parameters
        ----------
        position : ndarray, shape (n,)
            Along the interface [m].
        time : float
            [s]
        """
        return np.zeros_like(position)

    @property
    def onset(self) -> float:
        """When it begins [s], zero or less where it is there from the start."""
        return 0.0

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        """The law that acts instead of `law` (with its profiles evaluated at the points)."""
        return law


if TYPE_CHECKING:
    AnyNucleation = Nucleation
else:
    AnyNucleation = alternative("ruptfx.nucleation")
