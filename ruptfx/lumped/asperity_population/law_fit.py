"""Fit of a rate-and-state law to a friction trace at given slip rates."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from ruptfx import RuptfxError
from ruptfx.laws.friction.rate_and_state_base import RateAndState


@dataclass(frozen=True)
class Trace:
    """Friction at piecewise constant slip rate.

    Attributes
    ----------
    duration, slip_rate, friction : ndarray, shape (samples,)
        Duration [s] of each slip rate [m/s], and the friction coefficient at its end.
    """

    duration: np.ndarray
    slip_rate: np.ndarray
    friction: np.ndarray

    def predicted(self, law: RateAndState) -> tuple[np.ndarray, np.ndarray]:
        """Return friction coefficient and theta [s] of a law from steady sliding, shapes (samples,)."""
        theta = np.empty(len(self.duration))
        one, last = np.ones(()), np.asarray(law.D_c / self.slip_rate[0])
        bounds = [0, *(np.flatnonzero(np.diff(self.slip_rate)) + 1), len(theta)]
        for first, end in pairwise(bounds):  # `advance` is exact at a constant slip rate
            part, speed = slice(first, end), self.slip_rate[first] * one
            theta[part] = law.advance({"theta": last}, speed, one, np.cumsum(self.duration[part]))["theta"]
            last = theta[end - 1]
        return np.asarray(law.strength(self.slip_rate, one, {"theta": theta})), theta

    def fit(self, start: RateAndState) -> tuple[RateAndState, float]:
        """Fit a, b, D_c and f_0 by least squares over slip; return the law and its RMS misfit.

        Parameters
        ----------
        start : RateAndState
            Initial guess; its class and V_0 are kept.
        """
        weight = np.sqrt(self.duration * self.slip_rate)
        weight /= np.linalg.norm(weight)

        def law(x: np.ndarray) -> RateAndState:
            a, b, D_c = np.exp(x[:3])
            return start.model_copy(update={"a": float(a), "b": float(b), "D_c": float(D_c), "f_0": float(x[3])})

        def misfit(x: np.ndarray) -> np.ndarray:
            residual: np.ndarray = weight * (self.predicted(law(x))[0] - self.friction)
            return residual

        begin = [*np.log([float(start.a), float(start.b), float(start.D_c)]), float(start.f_0)]
        result = least_squares(misfit, begin, x_scale=[0.3, 0.3, 0.5, 0.01], diff_step=1e-4)
        if not result.success:
            raise RuptfxError(
                f"the fit of a law to the population failed: {result.message}; increase asperities or distance"
            )
        return law(result.x), float(np.linalg.norm(result.fun))
