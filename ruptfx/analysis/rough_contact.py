"""What theory says of two rough bodies that are pressed together: how much of them touches, and with which pressure.

Small slopes, no friction, half-spaces; E* of two bodies is 1 / (1 / E_1' + 1 / E_2') with E' = E / (1 - nu^2) in plane
strain and E in plane stress.
"""

from __future__ import annotations

from math import asin, erf, pi, sqrt
from typing import NamedTuple


class Touch(NamedTuple):
    """What touches: its part of the length, and the pressure there [Pa] (the largest, or the mean)."""

    fraction: float
    pressure: float


def full_contact_pressure(modulus: float, amplitude: float, wavelength: float) -> float:
    """p* = pi E* amplitude / wavelength, at which waves are in full contact [Pa].

    Parameters
    ----------
    modulus : float
        E* [Pa].
    amplitude, wavelength : float
        Of the distance of the two surfaces [m].

    Notes
    -----
    Source: Westergaard (1939); Johnson (1985), chapter 13.
    """
    return pi * modulus * amplitude / wavelength


def waves(pressure: float, full: float) -> Touch:
    """Of waves under a mean pressure, and their largest pressure: 2 sqrt(p p*) until they are in full contact.

    Notes
    -----
    Source: Westergaard (1939); Johnson (1985), chapter 13.
    """
    if pressure >= full:
        return Touch(1.0, pressure + full)
    return Touch(2 / pi * asin(sqrt(pressure / full)), 2 * sqrt(pressure * full))


def rough(pressure: float, modulus: float, slope: float) -> Touch:
    """Of surfaces with many wavelengths under a mean pressure, and the mean pressure where they touch.

    In full contact the pressure would have the standard deviation s = E* slope / 2; what touches is
    erf(p / (sqrt(2) s)).

    Parameters
    ----------
    pressure, modulus : float
        Mean pressure and E* [Pa].
    slope : float
        Root mean square slope of the distance of the surfaces.

    Notes
    -----
    Source: Persson (2001).
    """
    fraction = erf(sqrt(2) * pressure / (modulus * slope))
    return Touch(fraction, pressure / fraction)
