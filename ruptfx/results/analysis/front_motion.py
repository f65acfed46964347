"""Equation of motion of a front in non-uniform stress: how fast it runs at every length, and where it stops.

A front of length l releases G_s(l) = K_s^2 / E' at rest and g(v) G_s(l) at the speed v, as its speed, not its history,
sets the stress intensity; it runs so fast that this is the fracture energy: g(v) = Gamma(l) / G_s(l), and stops where
G_s(l) < Gamma(l). K_s is the static stress intensity of the stress drop tau(x) - mu_d sigma(x) over the ruptured part.
The function g is that of a semi-infinite crack: exact until waves come back from the other tip or from an edge. The
self-similar bilateral crack under a uniform drop, which hears its other tip for ever, needs 0.94 times that length at
0.5 c_R and 1.02 times it at 0.9 c_R. A bilateral front that slows down is caught up by the shear and Rayleigh waves of
the other tip, and goes farther than the equation says (`ruptfx bench stress_barrier`).
Source: Freund (1990), section 7.4; Kammer, Radiguet, Ampuero and Molinari (2015); Svetlizky, Bayart, Fineberg (2019).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ruptfx import RuptfxError
from ruptfx.laws.fracture import g_II
from ruptfx.results.analysis.near_tip import Medium

Array = np.ndarray
Along = Callable[[Array], Array]
SHAPES = ("bilateral", "edge", "one tip")
Shape = Literal["bilateral", "edge", "one tip"]

ANGLES = 2000
FASTEST = 0.999  # c_R, at the end of the table of g


@dataclass(frozen=True)
class FrontMotion:
    """Solution of the equation of motion of a front.

    Attributes
    ----------
    length : ndarray, shape (n,)
        Half-length of a bilateral rupture, or length of a rupture from an edge or with one tip [m].
    speed : ndarray, shape (n,)
        Front speed at each length [m/s]; zero beyond the arrest.
    time : ndarray, shape (n,)
        Arrival time, from the first length on [s]; infinite beyond the arrest.
    energy_ratio : ndarray, shape (n,)
        G_s / Gamma.
    arrest : float
        Arrest length [m]; NaN without arrest.
    """

    length: Array
    speed: Array
    time: Array
    energy_ratio: Array
    arrest: float


def static_stress_intensity(length: float, stress_drop: Along, shape: Shape, height: float | None = None) -> float:
    """Return K_s of a crack along y = 0 for a non-uniform stress drop [Pa sqrt(m)].

    Bilateral: 2 sqrt(l / pi) int_0^l drop(x) / sqrt(l^2 - x^2) dx, for a drop that is even in x. From an edge:
    2 / sqrt(pi l) int_0^l drop(x) (1.3 - 0.3 (x / l)^(5/4)) / sqrt(1 - (x / l)^2) dx, to 1 % (Source: Tada, Paris and
    Irwin 2000). One tip, of a crack that was there at x < 0 and from which a stress drop is taken at x > 0 only:
    sqrt(2 / pi) int_0^l drop(x) / sqrt(l - x) dx, for which the equation of motion is exact.

    Parameters
    ----------
    length : float
        l [m].
    stress_drop : callable
        Of positions from the middle, from the edge, or from where the one tip was [m]; gives Pa.
    shape : str
        "bilateral", "edge" or "one tip".
    height : float, optional
        H* = H G* / G [m] of two plates of height H whose far sides are fixed: K_s is that of an infinite body times
        sqrt(tanh(z) / z), z = pi l / (2 H*), which is exact in mode III and for short and long cracks in mode II:
        G_s = drop^2 H / G for l >> H (Source: energy of the strip; Tada, Paris and Irwin 2000 for mode III).
    """
    # Midpoints, as the drop may jump; x = l sin(angle), or l (1 - part^2), takes the singularity away.
    part = (np.arange(ANGLES) + 0.5) / ANGLES
    s = 1 - part**2 if shape == "one tip" else np.sin(0.5 * np.pi * part)
    profile = 1.3 - 0.3 * s**1.25 if shape == "edge" else np.ones(ANGLES)
    scale = np.sqrt(8 / np.pi) if shape == "one tip" else np.sqrt(np.pi)
    K = float(scale * np.sqrt(length) * np.mean(profile * stress_drop(length * s)))
    if height is None:
        return K
    z = 0.5 * np.pi * length / height
    return K * float(np.sqrt(np.tanh(z) / z))


def front_motion(
    lengths: Array,
    stress_drop: Along,
    fracture_energy: Along,
    medium: Medium,
    shape: Shape = "bilateral",
    height: float | None = None,
) -> FrontMotion:
    """Solve for the speed of a mode II front at every length, until it stops.

    Parameters
    ----------
    lengths : ndarray, shape (n,)
        Increasing lengths [m]; the first is the initial one.
    stress_drop, fracture_energy : callable
        tau(x) - mu_d sigma(x) [Pa] and Gamma(x) [J/m2] of positions [m].
    shape, height
        As in `static_stress_intensity`; `height` is that of one plate, H.

    Raises
    ------
    RuptfxError
        If lengths do not increase, the shape is unknown, or the front cannot start.
    """
    lengths = np.asarray(lengths, dtype=float)
    if shape not in SHAPES:
        raise RuptfxError(f"front_motion: shape = '{shape}': must be 'bilateral', 'edge' or 'one tip'")
    if len(lengths) < 2 or lengths[0] <= 0 or np.any(np.diff(lengths) <= 0):
        raise RuptfxError("front_motion: lengths must be positive, increase, and be at least two")
    effective = None if height is None else height * medium.modulus / (2 * medium.shear_modulus)
    K = np.array([static_stress_intensity(length, stress_drop, shape, effective) for length in lengths])
    ratio = np.maximum(K, 0.0) ** 2 / medium.modulus / fracture_energy(lengths)
    if ratio[0] <= 1:
        raise RuptfxError(
            f"front_motion: at {lengths[0]:.4g} m G_s is {ratio[0]:.3g} of the fracture energy: the front does not "
            "begin; begin with a longer one"
        )
    speeds = np.linspace(0, FASTEST * medium.c_R, 400)
    g = np.array([g_II(speed, medium.c_p, medium.c_s, medium.c_R) for speed in speeds])
    speed = np.interp(1 / np.maximum(ratio, 1e-300), g[::-1], speeds[::-1])  # g falls from one to zero
    stopped = ratio <= 1
    first = int(np.argmax(stopped)) if stopped.any() else len(lengths)
    arrest = np.nan
    if first < len(lengths):
        low, high = ratio[first - 1], ratio[first]
        arrest = float(lengths[first - 1] + (low - 1) / (low - high) * (lengths[first] - lengths[first - 1]))
        speed[first:] = 0.0
    with np.errstate(divide="ignore"):
        slowness = 1 / speed
    time = np.append(0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(lengths)))
    return FrontMotion(lengths, speed, time, ratio, arrest)
