"""Nucleations, one per file; the file name is the `kind` of an entry of ``[[faults.NAME.nucleation]]``.

A nucleation either adds shear traction to the initial stress, as a function of position and time, or weakens friction.
The initial state of the law is that of the stress without the nucleation.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import itemgetter
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.schema import Alternative, alternative
from ruptfx.laws.friction import FrictionLaw


class Nucleation(Alternative):
    """Contract of a nucleation."""

    offers_with: ClassVar[dict[str, str]] = {"weaken": "weakening", "shear_traction": "loading"}

    def shear_traction(self, position: np.ndarray, time: float) -> np.ndarray:
        """Return the shear traction [Pa] added along the first tangent, in 3D along the rake of the initial stress.

        Parameters
        ----------
        position : ndarray, shape (n,) or (n, 2)
            Positions along a line or on a surface [m]; `ruptfx.input.profiles.places.distance` is for both.
        time : float
            [s]
        """
        return np.zeros(len(position))

    @property
    def onset(self) -> float:
        """Start [s], zero or less if present from the start."""
        return 0.0

    def weaken(self, law: FrictionLaw, position: np.ndarray) -> FrictionLaw:
        """Return the law that replaces `law` (with its profiles evaluated at the points)."""
        return law


def first_begun(nucleations: Iterable[Nucleation]) -> tuple[float, float]:
    """Return time [s] and position [m] of the first nucleation that begins after zero.

    Minus infinity and NaN without one; a position of NaN where it has no `center`. On surfaces that along strike.
    """
    later = [each for each in nucleations if each.onset > 0]
    begun = [(each.onset, float(np.ravel(getattr(each, "center", np.nan))[0])) for each in later]
    return min(begun, key=itemgetter(0), default=(-np.inf, np.nan))


if TYPE_CHECKING:
    AnyNucleation = Nucleation
else:
    AnyNucleation = alternative("ruptfx.laws.nucleation")
