"""Coulomb viscoplasticity in plane strain."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.laws.materials import Plane, Tensor
from ruptfx.laws.materials._overstress import SMALLEST
from ruptfx.laws.materials.drucker_prager import DruckerPrager


class MohrCoulomb(DruckerPrager):
    """Plasticity on planes whose normal is in the section: the largest shear stress there against the mean stress.

    Yield: sqrt(((xx - yy) / 2)^2 + xy^2) <= Y = max(c cos phi - (xx + yy) sin phi / 2, 0), tension positive. The stress
    beyond Y decays with the relaxation time T as in `drucker_prager`, without plastic strain out of the plane.
    Source: Andrews (2005), JGR 110, B01307.
    """

    @classmethod
    def planes(cls) -> tuple[Plane, ...]:
        return ("strain",)

    def shear_and_strength(self, total: Tensor) -> tuple[Any, Any]:
        """Return the largest shear stress in the plane and its limit Y [Pa]."""
        deviator = self.flow(total)
        limit = self.cohesion * np.cos(self.friction_angle) - 0.5 * (total.xx + total.yy) * np.sin(self.friction_angle)
        return np.sqrt(deviator.xx * deviator.xx + deviator.xy * deviator.xy + SMALLEST), np.maximum(limit, 0.0)

    def flow(self, total: Tensor) -> Tensor:
        """Return the deviator of the stress in the plane [Pa]."""
        half = 0.5 * (total.xx - total.yy)
        return Tensor(xx=half, yy=-half, xy=total.xy)
