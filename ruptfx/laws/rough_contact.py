"""Theory of two rough bodies in normal contact: contact fraction and contact pressure.

Small slopes, no friction, half-spaces; E* of two bodies is 1 / (1 / E_1' + 1 / E_2') with E' = E / (1 - nu^2) in plane
strain and E in plane stress.
"""

from __future__ import annotations

from math import asin, erf, pi, sqrt
from typing import NamedTuple


class Touch(NamedTuple):
    """Contact fraction of the length, and pressure in contact [Pa] (the largest, or the mean)."""

    fraction: float
    pressure: float


def full_contact_pressure(modulus: float, amplitude: float, wavelength: float) -> float:
    """Return p* = pi E* amplitude / wavelength, the pressure of full contact of sinusoidal waves [Pa].

    Parameters
    ----------
    modulus : float
        E* [Pa].
    amplitude, wavelength : float
        Amplitude and wavelength of the gap between the surfaces [m].

    Notes
    -----
    Source: Westergaard (1939); Johnson (1985), chapter 13.
    """
    return pi * modulus * amplitude / wavelength


def waves(pressure: float, full: float) -> Touch:
    """Return the contact of sinusoidal waves with the largest pressure, 2 sqrt(p p*) until full contact.

    Notes
    -----
    Source: Westergaard (1939); Johnson (1985), chapter 13.
    """
    if pressure >= full:
        return Touch(1.0, pressure + full)
    return Touch(2 / pi * asin(sqrt(pressure / full)), 2 * sqrt(pressure * full))


def rough(pressure: float, modulus: float, slope: float) -> Touch:
    """Return the contact of surfaces with many wavelengths under a mean pressure, with the mean contact pressure.

    In full contact the pressure would have the standard deviation s = E* slope / 2; the contact fraction is
    erf(p / (sqrt(2) s)).

    Parameters
    ----------
    pressure, modulus : float
        Mean pressure and E* [Pa].
    slope : float
        Root mean square slope of the gap between the surfaces.

    Notes
    -----
    Source: Persson (2001).
    """
    fraction = erf(sqrt(2) * pressure / (modulus * slope))
    return Touch(fraction, pressure / fraction)
