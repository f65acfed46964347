"""Front properties of a law, in two families: weakening with slip, or with the slip rate.

Values are arrays at all points, or numbers at one of them; their type is that of what was given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Breakdown:
    """Strength lost with slip behind a front, as in slip weakening; one value per interface point.

    Attributes
    ----------
    peak, residual : ndarray or float
        Strength before and long after the front [Pa].
    energy : ndarray or float
        Fracture energy, the integral of strength - residual over the slip [J/m2].
    """

    peak: Any
    residual: Any
    energy: Any

    @property
    def drop(self) -> Any:
        """peak - residual [Pa]."""
        return self.peak - self.residual

    @property
    def slip(self) -> Any:
        """Slip of the linear law of the same drop and fracture energy, 2 Gamma / drop [m]."""
        return 2 * self.energy / self.drop

    def seismic_ratio(self, shear_stress: Any) -> Any:
        """Return S = (peak - tau_0) / (tau_0 - residual) (Source: Andrews 1976; Das and Aki 1977)."""
        return (self.peak - shear_stress) / (shear_stress - self.residual)

    def process_zone(self, modulus: Any) -> Any:
        """Return the process zone of a front at rest [m]; `modulus` is G* [Pa].

        See `fracture.static_process_zone`.
        """
        from ruptfx.laws import fracture  # imported late: runs do not need it

        return fracture.static_process_zone(modulus, self.slip, self.drop)

    def nucleation(self, modulus: Any) -> Any:
        """Return the half-length 0.579 G* D_c / drop [m] at which slow loading becomes unstable; `modulus` is G* [Pa].

        Source: Uenishi and Rice (2003).
        """
        return 0.579 * modulus * self.slip / self.drop


@dataclass(frozen=True)
class RateDependence:
    """Strength that changes with the logarithm of the slip rate, as in rate and state; one value per point.

    Attributes
    ----------
    direct : ndarray or float
        a sigma: instantaneous rise of the strength with ln V [Pa].
    evolution : ndarray or float
        b sigma: fall with ln V at steady state [Pa].
    slip : ndarray or float
        D_c, slip of that fall [m].
    """

    direct: Any
    evolution: Any
    slip: Any

    @property
    def weakening(self) -> Any:
        """(b - a) sigma [Pa]; not positive where sliding is stable."""
        return self.evolution - self.direct

    @property
    def critical_stiffness(self) -> Any:
        """k_c = (b - a) sigma / D_c [Pa/m] (Source: Ruina 1983)."""
        return self.weakening / self.slip

    def process_zone(self, modulus: Any) -> Any:
        """Return L_b = G* D_c / (b sigma) [m]; `modulus` is G* [Pa] (Source: Dieterich 1992)."""
        return modulus * self.slip / self.evolution

    def wavelength(self, modulus: Any) -> Any:
        """Return h* = pi G* D_c / ((b - a) sigma) [m], above which sliding is unstable; `modulus` is G* [Pa].

        Source: Rice and Ruina (1983).
        """
        return np.pi * modulus * self.slip / self.weakening

    def nucleation(self, modulus: Any) -> Any:
        """Return the half-length b / (pi (b - a)^2) G* D_c / sigma [m] of the ageing law with a / b > 0.5.

        Source: Rubin and Ampuero (2005).
        """
        return self.evolution / (np.pi * self.weakening**2) * modulus * self.slip
