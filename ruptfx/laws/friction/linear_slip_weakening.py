"""Linear slip weakening."""

from __future__ import annotations

import numpy as np

from ruptfx.laws.friction import Array
from ruptfx.laws.friction._slip_weakening import SlipWeakening


class LinearSlipWeakening(SlipWeakening):
    """Linear slip weakening: the coefficient falls from mu_s to mu_d over the slip D_c and stays there."""

    formula = "strength = [mu_s - (mu_s - mu_d) min(cumulative_slip / D_c, 1)] sigma"
    source = "Ida (1972); Andrews (1976)"
    whole = 0.5

    def remaining_fraction(self, ratio: Array) -> Array:
        return 1 - np.minimum(ratio, 1.0)
