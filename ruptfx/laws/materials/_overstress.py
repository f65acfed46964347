"""Viscoplastic flow: the stress beyond yield decays with a relaxation time."""

from __future__ import annotations

from typing import Any

import numpy as np

ROUNDING = 1e-12
"""Part of a stress that may be rounding where it is compared with a strength."""
SMALLEST = 1e-200
"""Added to the square of a shear stress [Pa2], so that its root has a derivative at zero."""


def relaxed(before: Any, beyond: Any, part: Any) -> Any:
    """Return how much of the overstress f flows in a step, exact for f' = g - f / T with a constant elastic rate g.

    f = f_0 exp(-dt / T) + g T (1 - exp(-dt / T)) at the end of the step; without flow it would be f_0 + g dt.

    Parameters
    ----------
    before : number, ndarray or traced expression
        Overstress f_0 at the beginning of the step [Pa], zero below yield.
    beyond : number, ndarray or traced expression
        Overstress f_0 + g dt at its end without flow [Pa], negative below yield.
    part : number, ndarray or traced expression
        Step over relaxation time, dt / T.

    Returns
    -------
    number, ndarray or traced expression
        Never negative [Pa].
    """
    kept = np.exp(-part)
    mean = np.where(part > 0, -np.expm1(-part) / np.where(part > 0, part, 1.0), 1.0)
    return np.maximum((1 - mean) * beyond + (mean - kept) * before, 0.0)
