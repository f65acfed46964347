"""Frictional fronts as cracks: near-tip functions, energy balance, equation of motion and wave speeds of interfaces.

Speeds in m/s, stresses in Pa, lengths in m. In plane stress pass the plate speed as c_p: every formula is written with
c_p and c_s only, E' = 2 G*, G* = 2 G (1 - (c_s / c_p)^2), which is G / (1 - nu) in plane strain and G (1 + nu) in plane
stress.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy

Mode = Literal["I", "II"]


def slowness_factors(speed: float, c_p: float, c_s: float) -> tuple[float, float]:
    """a_p and a_s, a_i = sqrt(1 - v^2 / c_i^2); zero above the wave speed."""
    return float(np.sqrt(max(1 - (speed / c_p) ** 2, 0))), float(np.sqrt(max(1 - (speed / c_s) ** 2, 0)))


def rayleigh_function(speed: float, c_p: float, c_s: float) -> float:
    """D = 4 a_s a_p - (1 + a_s^2)^2; zero at c_R (Source: Freund 1990, eq. 4.3.8)."""
    return min((speed / c_s) ** 2, 1.0) * _rayleigh_quotient(speed, c_p, c_s)


def _rayleigh_quotient(speed: float, c_p: float, c_s: float) -> float:
    """D c_s^2 / v^2, which slow fronts need: both terms of D are 4 at v = 0, and their difference is v^2 only.

    With x = v^2 / c_s^2 and k = c_s^2 / c_p^2, D times the sum of its two terms is
    16 (1 - x) (1 - k x) - (2 - x)^4, which is x times a polynomial.
    """
    a_p, a_s = slowness_factors(speed, c_p, c_s)
    x, k = min((speed / c_s) ** 2, 1.0), (c_s / c_p) ** 2
    return (16 * (1 - k) - (24 - 16 * k) * x + 8 * x**2 - x**3) / (4 * a_s * a_p + (1 + a_s**2) ** 2)


def effective_modulus(shear_modulus: float, c_p: float, c_s: float) -> float:
    """G* = G / (1 - nu) in plane strain, G (1 + nu) in plane stress [Pa]; E' = 2 G*."""
    return 2 * shear_modulus * (1 - (c_s / c_p) ** 2)


def A_II(speed: float, c_p: float, c_s: float) -> float:
    """Energy release over K_II^2 / E': v^2 a_s / ((1 - nu) c_s^2 D) (Source: Freund 1990, eq. 5.3.11).

    1 / (1 - nu) is G* / G = 2 (1 - c_s^2 / c_p^2). One at v = 0, unbounded at c_R.
    """
    _, a_s = slowness_factors(speed, c_p, c_s)
    return 2 * (1 - (c_s / c_p) ** 2) * a_s / _rayleigh_quotient(speed, c_p, c_s)


def A_I(speed: float, c_p: float, c_s: float) -> float:
    """Energy release over K_I^2 / E' of an opening crack: v^2 a_p / ((1 - nu) c_s^2 D) (Source: Freund 1990, ch. 5.3).

    One at v = 0, unbounded at c_R.
    """
    a_p, _ = slowness_factors(speed, c_p, c_s)
    return 2 * (1 - (c_s / c_p) ** 2) * a_p / _rayleigh_quotient(speed, c_p, c_s)


def k_II(speed: float, c_p: float, c_s: float, c_R: float) -> float:
    """Dynamic over static stress intensity of a semi-infinite mode II crack (Source: Freund 1990, eq. 6.4.42).

    k = (1 - v/c_R) / (S sqrt(1 - v/c_s)) with the factor S of the Rayleigh function at slowness 1/v,
    ln S = (1/pi) int_a^b arctan[4 n^2 sqrt((n^2 - a^2)(b^2 - n^2)) / (b^2 - 2 n^2)^2] dn / (n - 1/v), a = 1/c_p,
    b = 1/c_s.
    """
    if speed == 0:
        return 1.0
    a, b = 1 / c_p, 1 / c_s

    def integrand(n: float) -> float:
        angle = np.arctan2(4 * n**2 * np.sqrt(max((n**2 - a**2) * (b**2 - n**2), 0)), (b**2 - 2 * n**2) ** 2)
        return angle / (n - 1 / speed)

    factor = np.exp(scipy.integrate.quad(integrand, a, b, limit=200)[0] / np.pi)
    return float((1 - speed / c_R) / (factor * np.sqrt(1 - speed / c_s)))


def g_II(speed: float, c_p: float, c_s: float, c_R: float) -> float:
    """Dynamic over static energy release of a semi-infinite mode II crack: A_II k_II^2."""
    return A_II(speed, c_p, c_s) * k_II(speed, c_p, c_s, c_R) ** 2


def stress_intensity(fracture_energy: float, modulus: float, A: float = 1.0) -> float:
    """K [Pa sqrt(m)] at which G = A K^2 / E' is the fracture energy [J/m2]; `modulus` is E' [Pa]."""
    return float(np.sqrt(fracture_energy * modulus / A))


def critical_half_length(fracture_energy: float, modulus: float, stress_drop: float) -> float:
    """a_c = Gamma E' / (pi dtau^2) [m]: half-length at which a crack under uniform stress drop starts to grow."""
    return fracture_energy * modulus / (np.pi * stress_drop**2)


def self_similar_factor_II(speed: float, c_p: float, c_s: float) -> float:
    """F of a mode II crack that grows at constant speed: slip = 2 T / (G F) sqrt(v^2 t^2 - x^2).

    F = int_0^inf [(2 p^2 + b^2)^2 - 4 p^2 sqrt(p^2 + a^2) sqrt(p^2 + b^2)] / (b^2 sqrt(p^2 + b^2)) (1 + p^2)^(-3/2) dp
    with a = v/c_p, b = v/c_s (Source: Burridge and Willis 1969; Kostrov 1964).
    """
    return _self_similar_factor(speed, c_p, c_s, speed / c_s)


def self_similar_factor_I(speed: float, c_p: float, c_s: float) -> float:
    """F of a mode I crack that grows at constant speed: opening = 2 T / (G F) sqrt(v^2 t^2 - x^2).

    That of mode II with sqrt(p^2 + a^2) in place of the last root: stress over opening of a half space is
    that over slip with the two roots exchanged (Source: Broberg 1960; Freund 1990, ch. 6.3).
    """
    return _self_similar_factor(speed, c_p, c_s, speed / c_p)


def _self_similar_factor(speed: float, c_p: float, c_s: float, root: float) -> float:
    a, b = speed / c_p, speed / c_s

    def integrand(p: float) -> float:
        root_a, root_b = np.sqrt(p**2 + a**2), np.sqrt(p**2 + b**2)
        # (2 p^2 + b^2)^2 - 4 p^2 ra rb, with the cancellation at large p taken out: lower = p^4 - (ra rb)^2.
        lower = -(p**2 * (a**2 + b**2) + (a * b) ** 2)
        bracket = b**4 + 4 * p**2 * b**2 + 4 * p**2 * lower / (p**2 + root_a * root_b)
        return bracket / (b**2 * np.sqrt(p**2 + root**2)) * (1 + p**2) ** -1.5

    return float(scipy.integrate.quad(integrand, 0, np.inf, limit=500)[0])


def supershear_limit(c_p: float, c_s: float, c_R: float) -> float:
    """Largest S = (tau_p - tau_0) / (tau_0 - tau_r) at which a mode II crack may start to run faster than S waves.

    A self-similar crack at c_R carries no stress singularity; ahead of it the shear stress rises behind the P wave to a
    peak at the S wave. Where that peak reaches the strength a new crack begins. With the slip 2 T / (G F)
    sqrt(c_R^2 t^2 - x^2) of the stress drop T, inverted by Cagniard's method,
    (tau_peak - tau_0) / T = (c_R^2 c_s^2 / F) int_{1/c_p}^{1/c_s} 4 q^2 sqrt(q^2 - 1/c_p^2) / (1 - c_R^2 q^2)^(3/2) dq
    (Source: Burridge 1973; Andrews 1985). In plane strain 1.592, 1.775, 1.977, 2.199 at Poisson's ratio 0.20, 0.25,
    0.30, 0.35.
    """

    def rise(q: float) -> float:  # q is the slowness t / x
        return 4 * q**2 * np.sqrt(max(q**2 - c_p**-2, 0.0)) * (1 - (c_R * q) ** 2) ** -1.5

    peak = scipy.integrate.quad(rise, 1 / c_p, 1 / c_s, limit=200)[0]
    return float((c_R * c_s) ** 2 * peak / self_similar_factor_II(c_R, c_p, c_s))


def self_similar_factor_III(speed: float, c_s: float) -> float:
    """F of a mode III crack that grows at constant speed: E(k), k^2 = 1 - v^2 / c_s^2 (Source: Kostrov 1964)."""
    return float(scipy.special.ellipe(1 - (speed / c_s) ** 2))


def half_length_at(speed: float, c_p: float, c_s: float, mode: Mode = "II") -> float:
    """Return a / a_c of a bilateral crack of mode I or II under uniform stress drop at a given speed.

    Slip near the tip of the self-similar crack gives K = T sqrt(pi a) G* / (G F A); with G = A K^2 / E' equal to the
    fracture energy a / a_c = (G F / G*)^2 A.
    """
    if speed == 0:
        return 1.0
    factor, A = (self_similar_factor_I, A_I) if mode == "I" else (self_similar_factor_II, A_II)
    ratio = factor(speed, c_p, c_s) / (2 * (1 - (c_s / c_p) ** 2))
    return ratio**2 * A(speed, c_p, c_s)


def speed_at(half_length: float, c_p: float, c_s: float, c_R: float, mode: Mode = "II") -> float:
    """Equation of motion of a bilateral crack under uniform stress drop: speed [m/s] at a / a_c."""
    if half_length <= 1:
        return 0.0

    def excess(fraction: float) -> float:
        return half_length_at(fraction * c_R, c_p, c_s, mode) - half_length

    return float(scipy.optimize.brentq(excess, 1e-3, 1 - 1e-6)) * c_R if excess(1e-3) < 0 else 0.0


def static_process_zone(modulus: float, slip: float, strength_drop: float) -> float:
    """9 pi / 32 G* D_c / (tau_p - tau_r) [m], linear slip weakening; `modulus` is G* (Source: Palmer and Rice 1973)."""
    return 9 * np.pi / 32 * modulus * slip / strength_drop


def generalized_rayleigh_speed(speeds: Sequence[tuple[float, float, float]], moduli: Sequence[float]) -> float | None:
    """Speed of the interface wave of two bodies in frictionless contact [m/s], None where there is none.

    Root of the sum over the bodies of a_p (1 - a_s^2) / (G D) (Source: Weertman 1963; Achenbach and Epstein 1967).
    Where it exists, Coulomb friction between them is ill-posed at any coefficient (Ranjith and Rice 2001).

    Parameters
    ----------
    speeds : pair of (c_p, c_s, c_R) [m/s]
    moduli : pair of shear moduli [Pa]
    """

    def compliance(c: float) -> float:
        total = 0.0
        for (c_p, c_s, _), modulus in zip(speeds, moduli, strict=True):
            a_p, a_s = slowness_factors(c, c_p, c_s)
            total += a_p * (1 - a_s**2) / (modulus * rayleigh_function(c, c_p, c_s))
        return total

    rayleigh = [c_R for *_, c_R in speeds]
    low, high = min(rayleigh), min(min(c_s for _, c_s, _ in speeds), max(rayleigh))
    if high <= low * (1 + 1e-12):
        return low if max(rayleigh) < low * (1 + 1e-9) else None
    # Below the lower c_R both terms are positive; each passes through infinity at its own c_R.
    grid = np.linspace(low * (1 + 1e-9), high * (1 - 1e-9), 200)
    values = np.array([compliance(c) for c in grid])
    change = np.flatnonzero(values[:-1] * values[1:] < 0)
    return float(scipy.optimize.brentq(compliance, grid[change[0]], grid[change[0] + 1])) if len(change) else None
