"""A fibre pulled out of a matrix: the one-dimensional shear-lag solution.

The fibre, of radius R and Young's modulus E, is a bar whose surface carries the traction tau(x); the matrix moves with
the fibre's surface by tau / k, k = G / (R ln(R_o / R)) for a matrix of shear modulus G that is fixed at the radius R_o:

    (E R / 2) u'' = tau,    u at the loaded end x = 0 given, the other end, x = L, free.

Radial stresses are left out: the pressure on the fibre stays what it was. Lengths in m, stresses in Pa, forces in N.
Source: Cox (1952), Br. J. Appl. Phys. 3, 72, for the bar in a matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, pi, sqrt, tanh

import numpy as np

from ruptfx import RuptfxError


@dataclass(frozen=True)
class ShearLag:
    """Constants of fibre and matrix.

    Attributes
    ----------
    radius, outer_radius : float
        R and R_o [m].
    length : float
        L [m].
    young_modulus : float
        E of the fibre [Pa].
    shear_modulus : float
        G of the matrix [Pa].
    """

    radius: float
    outer_radius: float
    length: float
    young_modulus: float
    shear_modulus: float

    @property
    def matrix_stiffness(self) -> float:
        """Traction per displacement of the surface of the matrix [Pa/m]."""
        return self.shear_modulus / (self.radius * log(self.outer_radius / self.radius))

    @property
    def decay_length(self) -> float:
        """Length over which the load passes into the matrix before sliding [m]."""
        return sqrt(self.young_modulus * self.radius / (2 * self.matrix_stiffness))

    def pulled(self, strength: float, sliding: np.ndarray, energy: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement [m] and force [N] of the loaded end for a sliding zone of constant strength.

        In the sliding zone the traction is the strength, and where it ends tau_1 = strength + sqrt(2 k energy): as the
        bond breaks there, the matrix springs back and sets (tau_1 - strength)^2 / (2 k) free. Beyond it the load goes
        into the matrix: sigma_1 = E u_1 tanh((L - l) / lambda) / lambda with u_1 = tau_1 / k. Of a long fibre without
        friction the force is that of a debonding crack, pi R^2 sqrt(4 E energy / R).

        Parameters
        ----------
        strength : float
            Frictional strength of the sliding zone [Pa].
        sliding : ndarray
            Length l of the zone [m], from the loaded end.
        energy : float
            Fracture energy of the bond [J/m2].
        """
        E, R = self.young_modulus, self.radius
        at_tip = (strength + sqrt(2 * self.matrix_stiffness * energy)) / self.matrix_stiffness
        at_end = E * at_tip * np.tanh((self.length - sliding) / self.decay_length) / self.decay_length
        moved = at_tip + at_end * sliding / E + strength * sliding**2 / (E * R)
        return moved, pi * R**2 * (at_end + 2 * strength * sliding / R)

    def elastic_stiffness(self) -> float:
        """Return the force per displacement of the loaded end before sliding [N/m]."""
        return pi * self.radius**2 * self.young_modulus / self.decay_length * tanh(self.length / self.decay_length)

    def critical_length(self, weakening: float) -> float:
        """Return the length [m] above which steady sliding of the fibre is unstable under a rate and state law.

        The softest mode of a bar with one end fixed and the other free is a quarter of a wave, and gives the interface
        the stiffness 1 / (1 / (E R kappa^2 / 2) + 1 / k), kappa = pi / (2 L). It is unstable below the critical one,
        pressure (b - a) / D_c (Ruina 1983).

        Parameters
        ----------
        weakening : float
            pressure (b - a) / D_c [Pa/m].

        Raises
        ------
        RuptfxError
            The matrix is so soft that no length is stable.
        """
        if weakening >= self.matrix_stiffness:
            raise RuptfxError(
                f"critical_length: the matrix gives way with {self.matrix_stiffness:.4g} Pa/m, less than friction "
                f"weakens, {weakening:.4g} Pa/m: sliding is unstable at any length"
            )
        bar = 1 / (1 / weakening - 1 / self.matrix_stiffness)
        return 0.5 * pi * sqrt(self.young_modulus * self.radius / (2 * bar))
