"""Ways to start a rupture, one per file; the file name is the `kind` of an entry of ``[[faults.NAME.nucleation]]``.

A nucleation either adds shear traction to the initial stress, as a function of place and time, or weakens friction.
The state of the law is that of the stress without it.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import itemgetter
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


def first_begun(nucleations: Iterable[Nucleation]) -> tuple[float, float]:
    """When [s] and at which position [m] the first one begins that does so after zero.

    Minus infinity and NaN without one; a position of NaN where it has no `center`.
    """
    begun = [(each.onset, float(getattr(each, "center", np.nan))) for each in nucleations if each.onset > 0]
    return min(begun, key=itemgetter(0), default=(-np.inf, np.nan))


if TYPE_CHECKING:
    AnyNucleation = Nucleation
else:
    AnyNucleation = alternative("ruptfx.nucleation")
