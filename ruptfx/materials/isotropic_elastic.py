"""Isotropic linear elasticity."""

from __future__ import annotations

from functools import lru_cache
from math import sqrt
from typing import Any

import numpy as np

from ruptfx.materials import Material, Plane, WaveSpeeds
from ruptfx.units import Modulus, PoissonRatio


class IsotropicElastic(Material):
    """Isotropic linear elasticity (Hooke's law)."""

    young_modulus: Modulus
    """Young's modulus."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio."""

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) [Pa]."""
        return self.young_modulus / (2 * (1 + self.poisson_ratio))

    def lame_lambda(self, plane: Plane) -> float:
        """First Lamé parameter [Pa]; in plane stress the effective one, 2 lambda G / (lambda + 2 G)."""
        nu = self.poisson_ratio
        if plane == "stress":
            return self.young_modulus * nu / (1 - nu**2)
        return self.young_modulus * nu / ((1 + nu) * (1 - 2 * nu))

    def lame(self, plane: Plane) -> tuple[float, float]:
        return self.lame_lambda(plane), self.shear_modulus

    def energy_density(self, strain: Any, plane: Plane) -> Any:
        """lambda tr(e)^2 / 2 + G e:e; in antiplane G |grad w|^2 / 2."""
        import ufl

        if plane == "antiplane":
            return 0.5 * self.shear_modulus * ufl.inner(strain, strain)
        return 0.5 * self.lame_lambda(plane) * ufl.tr(strain) ** 2 + self.shear_modulus * ufl.inner(strain, strain)

    def wave_speeds(self, plane: Plane) -> WaveSpeeds:
        c_s = sqrt(self.shear_modulus / self.density)
        if plane == "antiplane":
            return WaveSpeeds(c_s, c_s, c_s)
        c_p = sqrt((self.lame_lambda(plane) + 2 * self.shear_modulus) / self.density)
        return WaveSpeeds(c_p, c_s, rayleigh_speed(c_p, c_s))


@lru_cache
def rayleigh_speed(c_p: float, c_s: float) -> float:
    """Root of D = 4 a_s a_p - (1 + a_s^2)^2 with a_i = sqrt(1 - c^2 / c_i^2) (Source: Rayleigh 1885).

    Parameters
    ----------
    c_p, c_s : float
        Body wave speeds [m/s].

    Returns
    -------
    float
        Rayleigh speed [m/s].
    """

    # Squared, with x = (c / c_s)^2 and without its root x = 0: 16 (1 - x) (1 - k x) = (2 - x)^4.
    k = (c_s / c_p) ** 2
    roots = np.roots([1, -8, 24 - 16 * k, -16 * (1 - k)])
    return c_s * sqrt(next(root.real for root in roots if abs(root.imag) < 1e-6 and 0 < root.real < 1))
