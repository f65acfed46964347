"""Diffusion across an interface, from a source on it: one-dimensional along the normal at every point.

    dD/dt = alpha d2D/dy2 + q(t) g(y),   g = exp(-y^2 / (2 w^2)) / (w sqrt(2 pi)), or a plane, w = 0

in wavenumbers l, where each amplitude obeys dD_l/dt = -alpha l^2 D_l + q and is advanced by exact exponentials for a
source that is linear in a step; there is no limit of stability. The value at y = 0 is the integral over l of
exp(-l^2 w^2 / 2) D_l / pi, by the trapezoidal rule in ln l, which converges exponentially.
Source: Noda and Lapusta (2010), J. Geophys. Res. 115, B12314, appendix A.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SPACING = 0.4
"""Of ln l: an error of 4e-6 of the value, exp(-pi^2 / (2 SPACING))."""
LONGEST = 0.05
"""Smallest wavenumber times the width of the diffused source at the end of a run."""
SHORTEST = 6.0
"""Largest wavenumber times the width of the source, at which its Gaussian is 2e-8."""
BRIEFEST = 1e-12
"""Time over the duration of a run below which the memory of a plane source ends."""
BEYOND = 40
"""Wavenumbers above the largest one in which a plane source has no memory from step to step."""


class _Step(NamedTuple):
    """Factors of amplitudes, heat and growth of the power [s] in a step, and their sums in the value on the plane."""

    decay: np.ndarray
    by_heat: np.ndarray
    by_growth: np.ndarray
    value_by_heat: np.ndarray
    value_by_growth: np.ndarray


class Across:
    """Amplitudes and value on the interface for unit heat capacity.

    Parameters
    ----------
    diffusivity : ndarray, shape (n,) or (1,)
        [m2/s].
    width : float
        w [m]; 0 is a plane.
    duration : float
        Of the run [s].
    """

    def __init__(self, diffusivity: np.ndarray, width: float, duration: float) -> None:
        self._alpha = diffusivity if np.ptp(diffusivity) > 0 else diffusivity[:1]
        fastest, slowest = float(self._alpha.max()), float(self._alpha.min())
        first = LONGEST / np.sqrt(width**2 + 4 * fastest * duration)
        shortest = width if width > 0 else np.sqrt(slowest * BRIEFEST * duration)
        count = int(np.ceil(np.log(SHORTEST / shortest / first) / SPACING)) + 1
        ln = np.log(first) + SPACING * np.arange(count + (BEYOND if width == 0 else 0))
        wavenumber = np.exp(ln)
        weight = SPACING * wavenumber / np.pi * np.exp(-0.5 * (wavenumber * width) ** 2)
        weight[0] /= -np.expm1(-SPACING)  # with all smaller wavenumbers, whose amplitudes are equal
        self._rates, self._weight, self.count = self._alpha[:, None] * wavenumber**2, weight, count
        self._known: tuple[float, _Step] | None = None

    def _step(self, dt: float) -> _Step:
        if self._known is None or self._known[0] != dt:
            x = self._rates * dt
            small = np.minimum(x, 1e-3)
            large = np.maximum(x, 1e-3)
            heat = np.where(x < 1e-3, 1 - small / 2 + small**2 / 6, -np.expm1(-large) / large)
            late = np.where(x < 1e-3, 0.5 - small / 6 + small**2 / 24, (1 - heat) / large)
            growth = dt * (late - 0.5 * heat)  # of a source that grows linearly from -1/2 to 1/2
            sums = [(self._weight * each).sum(axis=1) for each in (heat, growth)]
            kept = slice(None, self.count)
            step = _Step(np.exp(-x[:, kept]), heat[:, kept], growth[:, kept], sums[0], sums[1])
            self._known = dt, step
        return self._known[1]

    def value(self, amplitudes: np.ndarray, dt: float, heat: np.ndarray, growth: np.ndarray) -> np.ndarray:
        """Return the value on the interface after a step, shape (n,).

        Parameters
        ----------
        amplitudes : ndarray, shape (n, count)
            At the begin of the step.
        heat, growth : ndarray, shape (n,)
            Integral of the source over the step, and change of the source from its begin to its end.
        """
        if dt == 0:
            return np.asarray(amplitudes @ self._weight[: self.count])
        step = self._step(dt)
        weighted = step.decay * self._weight[: self.count]
        past = amplitudes @ weighted[0] if len(weighted) == 1 else np.einsum("nk,nk->n", amplitudes, weighted)
        return np.asarray(past + step.value_by_heat * heat + step.value_by_growth * growth)

    def advance(self, amplitudes: np.ndarray, dt: float, heat: np.ndarray, growth: np.ndarray) -> None:
        """Set the amplitudes to those at the end of a step, with the arguments of `value`."""
        step = self._step(dt)
        amplitudes *= step.decay
        amplitudes += step.by_heat * heat[:, None]
        amplitudes += step.by_growth * growth[:, None]

    def uncertainty(self, dt: float, growth: np.ndarray) -> np.ndarray:
        """Return the part of the value that the growth of the source in the step makes, in its unit and shape."""
        return np.abs(self._step(dt).value_by_growth * growth) if dt > 0 else np.zeros_like(growth)
