"""Exponential slip weakening."""

from __future__ import annotations

import numpy as np

from ruptfx.laws.friction import Array
from ruptfx.laws.friction._slip_weakening import SlipWeakening


class ExponentialSlipWeakening(SlipWeakening):
    """Exponential slip weakening: the coefficient falls from mu_s to mu_d, by a factor e of the rest per slip D_c.

    The fracture energy is (mu_s - mu_d) sigma D_c, twice that of the linear law with the same D_c.
    """

    formula = "strength = [mu_d + (mu_s - mu_d) exp(-cumulative_slip / D_c)] sigma"
    source = "exponential member of the slip-dependent laws of Ida (1972)"
    whole = 1.0

    def remaining_fraction(self, ratio: Array) -> Array:
        return np.exp(-ratio)
