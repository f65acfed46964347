"""Low-pass filter of instruments: one step, and a whole trace."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def low_pass(before: np.ndarray, now: np.ndarray, smooth: np.ndarray, step: float, constant: np.ndarray) -> np.ndarray:
    """Return the output of constant dy/dt = x - y after a step [s] with x linear from `before` to `now`."""
    slope = (now - before) / step
    lag = slope * constant
    with np.errstate(divide="ignore"):
        decay = np.exp(-step / constant)  # 0 without a filter
    return np.asarray(now - lag + (smooth - before + lag) * decay)


def filtered(times: Floats, values: Floats, bandwidth: float | None) -> Floats:
    """Return a trace behind a low-pass filter with one pole, exact for values that are linear between the times.

    Parameters
    ----------
    times, values : ndarray, shape (m,)
        [s]; the filter starts at rest at the first value.
    bandwidth : float or None
        Frequency of half power [Hz]; None for no filter.
    """
    if bandwidth is None:
        return values
    constant, result = np.array(0.5 / np.pi / bandwidth), values.copy()
    for n in range(1, len(values)):
        result[n] = low_pass(values[n - 1], values[n], result[n - 1], times[n] - times[n - 1], constant)
    return result
