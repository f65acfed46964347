"""What a law says of the fronts it makes, in two families: strength lost with slip, or with the rate of slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.fields import Array


@dataclass(frozen=True)
class Breakdown:
    """Strength that a front takes away with slip, as slip weakening does; by point of an interface.

    Attributes
    ----------
    peak, residual : ndarray or float
        Strength before and long after the front [Pa].
    energy : ndarray or float
        Fracture energy, the integral of strength - residual over the slip [J/m2].
    """

    peak: Array
    residual: Array
    energy: Array

    @property
    def drop(self) -> Array:
        """peak - residual [Pa]."""
        return self.peak - self.residual

    @property
    def slip(self) -> Array:
        """Slip of the linear law of the same drop and fracture energy, 2 Gamma / drop [m]."""
        return 2 * self.energy / self.drop

    def seismic_ratio(self, shear_stress: Array) -> Array:
        """S = (peak - tau_0) / (tau_0 - residual) (Source: Andrews 1976; Das and Aki 1977)."""
        return (self.peak - shear_stress) / (shear_stress - self.residual)

    def process_zone(self, modulus: Array) -> Array:
        """Of a front at rest [m], see `fracture.static_process_zone`; `modulus` is G* [Pa]."""
        from ruptfx.analysis import fracture  # a run has no need of it

        return fracture.static_process_zone(modulus, self.slip, self.drop)

    def nucleation(self, modulus: Array) -> Array:
        """Half-length 0.579 G* D_c / drop [m] at which slow loading ends, whatever the load; `modulus` is G* [Pa].

        Source: Uenishi and Rice (2003).
        """
        return 0.579 * modulus * self.slip / self.drop


@dataclass(frozen=True)
class RateDependence:
    """Strength that changes with the logarithm of the slip rate, as in rate and state; by point of an interface.

    Attributes
    ----------
    direct : ndarray or float
        a sigma: rise of the strength with ln V at once [Pa].
    evolution : ndarray or float
        b sigma: fall with ln V in the long run [Pa].
    slip : ndarray or float
        D_c, over which it falls [m].
    """

    direct: Array
    evolution: Array
    slip: Array

    @property
    def weakening(self) -> Array:
        """(b - a) sigma [Pa]; not positive where sliding is stable."""
        return self.evolution - self.direct

    @property
    def critical_stiffness(self) -> Array:
        """k_c = (b - a) sigma / D_c [Pa/m] (Source: Ruina 1983)."""
        return self.weakening / self.slip

    def process_zone(self, modulus: Array) -> Array:
        """L_b = G* D_c / (b sigma) [m]; `modulus` is G* [Pa] (Source: Dieterich 1992)."""
        return modulus * self.slip / self.evolution

    def wavelength(self, modulus: Array) -> Array:
        """h* = pi G* D_c / ((b - a) sigma) [m]: longer waves of sliding grow; `modulus` is G* [Pa].

        Source: Rice and Ruina (1983).
        """
        return np.pi * modulus * self.slip / self.weakening

    def nucleation(self, modulus: Array) -> Array:
        """Half-length b / (pi (b - a)^2) G* D_c / sigma [m] of the ageing law with a / b > 0.5.

        Source: Rubin and Ampuero (2005).
        """
        return self.evolution / (np.pi * self.weakening**2) * modulus * self.slip
