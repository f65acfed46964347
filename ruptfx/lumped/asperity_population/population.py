"""Asperities under a common load: each creeps, and is replaced by a new one after a length of slip.

Asperity i has a height z_i, of which p_i has crept away, and is pressed by the distance between z_i - p_i and the
separation d of the surfaces. It is a spring in series with a dashpot of thermally activated flow,

    f_i = k max(z_i - p_i - d, 0),    dp_i/dt = r sinh(f_i / f_0),    sum f_i = W,

where the last equation gives d. At constant d the force relaxes exactly as tanh(f / 2 f_0) exp(-k r t / f_0), which is
logarithmic in time as long as f >> f_0. The tip is a sphere: under increasing approach its contact has the
area pi R (z_i - d), whatever the force history (Lee and Radok 1960, J. Appl. Mech. 27, 438). Heights are exponentially
distributed, the model of Greenwood and Williamson (1966, Proc. R. Soc. A 295, 300) for high asperities.
They are quantiles, and a fresh asperity has the height of the one it replaces: in an infinite population that is the
same as drawing it anew, and in a finite one the number of contacts does not scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from ruptfx import RuptfxError


@dataclass(frozen=True)
class Asperity:
    """Constants of every asperity.

    Attributes
    ----------
    stiffness : float
        k [N/m].
    activation_force : float
        f_0 [N].
    creep_rate : float
        r [m/s].
    height_scale : float
        s [m], standard deviation of the heights.
    mean_length, length_shape : float
        Mean slip [m] after which an asperity is replaced, and the shape of its gamma distribution: 1 is exponential,
        large is the same for all.
    """

    stiffness: float
    activation_force: float
    creep_rate: float
    height_scale: float
    mean_length: float
    length_shape: float

    def relaxed(self, force: np.ndarray, time: np.ndarray | float) -> np.ndarray:
        """Return the force [N] after a time [s] at constant separation.

        Computed with u = exp(-f / f_0), which stays accurate where tanh(f / 2 f_0) rounds to 1.
        """
        lost = -np.expm1(-self.stiffness * self.creep_rate / self.activation_force * time)
        u = np.exp(-force / self.activation_force)
        kept = 2 - lost
        left: np.ndarray = -self.activation_force * np.log((lost + u * kept) / (kept + u * lost))
        return left

    def mean_force(self, slip_rate: float) -> float:
        """Return the mean force [N] of a contact of an infinite population in steady sliding.

        The pressed height is exponential with mean s; the slip x since replacement has the density S(x) / mean length,
        S being the survival function of the lengths.
        """
        nodes, weights = np.polynomial.legendre.leggauss(400)
        reach = 40 * (nodes + 1) / 2
        pressed, likely = self.height_scale * reach, 20 * weights * np.exp(-reach)
        far = np.linspace(-40, np.log(60), 401)  # ln of the slip over the mean length
        slip = np.exp(far)
        density = slip * gammaincc(self.length_shape, self.length_shape * slip)
        force = self.relaxed(self.stiffness * pressed[:, None], slip * self.mean_length / slip_rate)
        return float(likely @ np.trapezoid(force * density, far, axis=1))


class Population:
    """State of all asperities.

    Parameters
    ----------
    asperity : Asperity
    number : int
        Number of asperities.
    load : float
        W [N].
    seed : int

    Attributes
    ----------
    height, crept, left, age : ndarray, shape (number,)
        z and p [m], remaining slip before replacement [m], age since replacement [s].
    separation : float
        d [m].
    """

    def __init__(self, asperity: Asperity, number: int, load: float, seed: int) -> None:
        self.asperity, self.load, self.random = asperity, load, np.random.default_rng(seed)
        self.height = -asperity.height_scale * np.log((np.arange(number) + 0.5) / number)
        self.crept, self.age = np.zeros(number), np.zeros(number)
        self.left = self._lengths(number)
        self.separation = 0.0
        self._settle()

    def _lengths(self, number: int) -> np.ndarray:
        shape = self.asperity.length_shape
        return self.random.gamma(shape, self.asperity.mean_length / shape, number)

    def pressed(self) -> np.ndarray:
        """Return the elastic shortening [m] of every asperity, 0 if not in contact."""
        return np.maximum(self.height - self.crept - self.separation, 0.0)

    def area_height(self) -> float:
        """Return the sum of z - d [m] over the contacts, their area over pi R."""
        return float((self.height - self.separation)[self.pressed() > 0].sum())

    def mean_age(self) -> float:
        """Return the mean age of the contacts [s]."""
        return float(self.age[self.pressed() > 0].mean())

    def advance(self, slip_rate: float, dt: float) -> None:
        """Slide for a time [s]: asperities creep at the old separation, which is then updated to balance the load."""
        creeping = self._replace(slip_rate, dt) if slip_rate > 0 else dt
        self.age += creeping
        before = self.asperity.stiffness * self.pressed()
        self.crept += (before - self.asperity.relaxed(before, creeping)) / self.asperity.stiffness
        self._settle()

    def _replace(self, slip_rate: float, dt: float) -> np.ndarray:
        """Replace asperities whose slip has ended; return the creep time [s] of each, old or new, in this step."""
        creeping = np.full(len(self.left), dt)
        self.left -= slip_rate * dt
        while len(over := np.flatnonzero(self.left < 0)):
            length = self._lengths(len(over))
            self.left[over] += length
            self.crept[over] = self.age[over] = 0.0
            creeping[over] = (length - self.left[over]) / slip_rate
        return creeping

    def _settle(self) -> None:
        """Find the separation at which the forces balance the load, by Newton's method on a convex function."""
        top, k = self.height - self.crept, self.asperity.stiffness
        self.separation = min(self.separation, float(top.max()) - self.load / k / len(top))
        for _ in range(100):
            touching = top > self.separation
            step = (k * (top[touching] - self.separation).sum() - self.load) / (k * touching.sum())
            self.separation += step
            if abs(step) <= 1e-14 * self.asperity.height_scale:
                break
        carried = k * np.maximum(top - self.separation, 0.0).sum()
        if not abs(carried - self.load) <= 1e-9 * self.load:
            raise RuptfxError(
                f"no separation of the surfaces carries the load of {self.load:g} N: {carried:g} N at "
                f"{self.separation:g} m; decrease normal_force, or increase stiffness"
            )
        if self.separation < 0:
            raise RuptfxError(
                f"{len(top)} asperities are too few for a load of {self.load:g} N: all of them touch; give more "
                "asperities or a smaller normal_force"
            )
