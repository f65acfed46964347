"""Explicit Runge-Kutta steps of order five with an error estimate of order four.

Source: Dormand and Prince (1980), J. Comput. Appl. Math. 6, 19, table 2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

NODES = (0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1)
"""Times of the stages over the step; the last stage is at its end."""
WEIGHTS = tuple(np.array(row) for row in (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
))  # fmt: skip
"""Weights of the earlier stages in each; those of the last stage are the solution of order five."""
ERROR = np.array([-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40])
"""Solution of order four less that of order five."""
Answer = TypeVar("Answer")


def attempt(
    slope: Callable[[float, np.ndarray], tuple[np.ndarray, Answer]], start: np.ndarray, dt: float,
    first: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, Answer]:  # fmt: skip
    """Return the end of a step, its absolute error, and the second value of `slope` at the end.

    Parameters
    ----------
    slope : callable, (part of the step, y) -> (dy/dt, Answer)
    first : ndarray, optional
        Slope at the start where it is known: that of the last stage of the step before.
    """
    slopes = np.zeros((len(NODES), *start.shape))
    for stage, (part, weights) in enumerate(zip(NODES, WEIGHTS, strict=True)):
        if stage == 0 and first is not None:
            slopes[0] = first
            continue
        y = start + dt * np.tensordot(weights, slopes[:stage], 1)
        slopes[stage], answer = slope(part, y)
    return y, np.abs(dt * np.tensordot(ERROR, slopes, 1)), answer
