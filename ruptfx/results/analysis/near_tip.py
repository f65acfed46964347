"""Fields around the tip of a crack that runs along y = 0: modes II and III, and mode II faster than shear waves.

The tip is at the origin and runs towards positive x, at a constant speed v, in two bodies of the same material. Its
faces carry what acts on them far behind the tip; the fields here come on top of that uniform state. Potentials are

    phi_xx = P Im z_p^n,   psi_xx = Q Re z_s^n,   z_i = x + i a_i y,   a_i = sqrt(1 - v^2 / c_i^2),

with u_x = phi_x + psi_y, u_y = phi_y - psi_x. Faces without further traction need Q = (1 + a_s^2) / (2 a_s) P for
every n = -1/2, 1/2, 3/2 ...: the singular field and those that follow it at a distance. The first has the stress
intensity K_II = lim sigma_xy sqrt(2 pi x), which gives P = 2 a_s K_II / (G D sqrt(2 pi)), D the Rayleigh function.
Source: Freund (1990), section 4.3; Svetlizky and Fineberg (2014).

In plane stress c_p is the speed of the plate, as in `fracture`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.laws.fracture import effective_modulus, rayleigh_function, slowness_factors

if TYPE_CHECKING:
    from ruptfx.laws.materials import Plane
    from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

Array = np.ndarray

SLOWEST = 1e-4  # c_s: smallest speed evaluated (error 1e-8); at rest both terms of the stresses diverge as 4 / D


@dataclass(frozen=True)
class Medium:
    """Wave speeds and shear modulus of a body, as input to the near-tip fields.

    Attributes
    ----------
    c_p, c_s, c_R : float
        Wave speeds [m/s]; in plane stress c_p is that of the plate.
    shear_modulus : float
        [Pa]
    """

    c_p: float
    c_s: float
    c_R: float
    shear_modulus: float

    @classmethod
    def of(cls, material: IsotropicElastic, plane: Plane) -> Medium:
        """Return the medium of a material of a case, in plane stress or strain."""
        return cls(*material.wave_speeds(plane), material.shear_modulus)

    @property
    def modulus(self) -> float:
        """E' [Pa]: E / (1 - nu^2) in plane strain, E in plane stress."""
        return 2 * effective_modulus(self.shear_modulus, self.c_p, self.c_s)

    @property
    def density(self) -> float:
        """Mass per volume [kg/m3]."""
        return self.shear_modulus / self.c_s**2


@dataclass(frozen=True)
class Plane2D:
    """Strains and particle velocities in the plane, arrays of one shape.

    Attributes
    ----------
    xx, yy, xy : ndarray
        Strains [1]; xy is the component of the tensor, half of the engineering shear.
    velocity_x, velocity_y : ndarray
        [m/s]
    """

    xx: Array
    yy: Array
    xy: Array
    velocity_x: Array
    velocity_y: Array

    def stress(self, medium: Medium) -> tuple[Array, Array, Array]:
        """Stresses xx, yy, xy [Pa], tension positive."""
        shear = medium.shear_modulus
        mean = shear * ((medium.c_p / medium.c_s) ** 2 - 2) * (self.xx + self.yy)
        return mean + 2 * shear * self.xx, mean + 2 * shear * self.yy, 2 * shear * self.xy


def _potentials(phi: tuple[Array, Array, Array], psi: tuple[Array, Array, Array], speed: float) -> Plane2D:
    """Fields of the second derivatives xx, xy, yy of both potentials; du/dt = -v du/dx."""
    return Plane2D(
        xx=phi[0] + psi[1],
        yy=phi[2] - psi[1],
        xy=phi[1] + 0.5 * (psi[2] - psi[0]),
        velocity_x=-speed * (phi[0] + psi[1]),
        velocity_y=-speed * (phi[1] - psi[0]),
    )


def mode_II(
    x: Array, y: Array, speed: float, medium: Medium, K_II: float = 1.0, power: float = -0.5, zone: float = 0.0
) -> Plane2D:
    """Return the field of mode II below the Rayleigh speed.

    Parameters
    ----------
    x, y : ndarray, one shape
        From the tip [m]; behind it y = 0 is the upper face.
    speed : float
        [m/s]
    K_II : float
        Coefficient of the field: sigma_xy = K_II x^power / sqrt(2 pi) ahead of the tip; with the power -1/2 the stress
        intensity [Pa sqrt(m)].
    power : float
        -1/2, or 1/2, 3/2 ... for the fields that grow with the distance.
    zone : float
        Length of a process zone behind the tip [m]: the mean of the fields of sharp tips within it. The shear stress
        falls there as sqrt(1 + x / zone) from its peak, which is 2 K_II / sqrt(2 pi zone) for the power -1/2.

    Returns
    -------
    Plane2D

    Raises
    ------
    RuptfxError
        A speed of c_R or more, or below zero.
    """
    if not 0 <= speed < medium.c_R:
        raise RuptfxError(
            f"near_tip: speed = {speed:.6g} m/s: the fields of mode II need 0 <= speed < c_R = {medium.c_R:.6g} m/s; "
            "use mode_II_supershear above c_s, there are none between c_R and c_s"
        )
    slow = max(speed, SLOWEST * medium.c_s)
    a_p, a_s = slowness_factors(slow, medium.c_p, medium.c_s)
    P, Q = _coefficients(slow, medium, K_II)
    f, g = (_mean_power(x, a * y, power, zone) for a in (a_p, a_s))
    phi = P * f.imag, P * a_p * f.real, -P * a_p**2 * f.imag
    psi = Q * g.real, -Q * a_s * g.imag, -Q * a_s**2 * g.real
    return _potentials(phi, psi, speed)


def mode_II_rate(
    x: Array, y: Array, time: Array, speed: float, medium: Medium, rate: float = 1.0, zone: float = 0.0
) -> Plane2D:
    """Return the field of a growing stress intensity, K_II = rate x time, at constant speed.

    It is an addition to `mode_II`.

    With F and G the potentials of `mode_II` per K_II, of the power -1/2,

        phi = rate ((time - x v / (c_p a_p)^2) F + p Im z_p^(5/2)),    psi = rate (time - x v / (c_s a_s)^2) G

    solve the wave equations exactly, and p cancels the normal stress on the faces. Far
    from the tip it grows with sqrt(r), and its last parts with v / (c_s a_s)^2, which is unbounded towards c_s.
    Source: Freund (1990), section 4.4; Freund and Rosakis (1992), J. Mech. Phys. Solids 40, 699, for mode I.

    Parameters
    ----------
    x, y : ndarray
        From the tip [m]; behind it y = 0 is the upper face.
    time : ndarray
        Since K_II was zero [s].
    rate : float
        [Pa sqrt(m) / s]
    zone : float
        As in `mode_II` [m].
    """
    slow = max(speed, SLOWEST * medium.c_s)
    a_p, a_s = slowness_factors(slow, medium.c_p, medium.c_s)
    P, Q = _coefficients(slow, medium, rate)
    b_p, b_s = (slow / (c * a) ** 2 for c, a in ((medium.c_p, a_p), (medium.c_s, a_s)))
    kappa = (medium.c_p / medium.c_s) ** 2
    # On the faces phi_xx, phi_yy and psi_xy of the terms with x are 5, -a_p^2 and -3 a_s times those of z^(1/2).
    face = b_p * P * ((kappa - 2) * (5 - a_p**2) - 2 * a_p**2) + 6 * a_s * b_s * Q
    p = -face / (1 + a_s**2)
    f, g = (_mean_power(x, a * y, -0.5, zone) for a in (a_p, a_s))
    f_1, g_1 = (_mean_power(x, a * y, 0.5, zone) for a in (a_p, a_s))
    f_x, g_x = f_1 - 1j * a_p * y * f, g_1 - 1j * a_s * y * g  # of x z^(-1/2): x = z - i a y, in the zone, too
    phi = (
        P * (time * f.imag - b_p * (4 * f_1 + f_x).imag) + p * f_1.imag,
        P * a_p * (time * f.real - b_p * (2 * f_1 + f_x).real) + p * a_p * f_1.real,
        -(a_p**2) * (P * (time * f.imag - b_p * f_x.imag) + p * f_1.imag),
    )
    psi = (
        Q * (time * g.real - b_s * (4 * g_1 + g_x).real),
        -Q * a_s * (time * g.imag - b_s * (2 * g_1 + g_x).imag),
        -(a_s**2) * Q * (time * g.real - b_s * g_x.real),
    )
    field = _potentials(phi, psi, speed)
    # du/dt is -v du/dx and what grows with the time.
    return replace(
        field,
        velocity_x=field.velocity_x + 2 * P * f_1.imag - 2 * a_s * Q * g_1.imag,
        velocity_y=field.velocity_y + 2 * a_p * P * f_1.real - 2 * Q * g_1.real,
    )


def _coefficients(speed: float, medium: Medium, K_II: float) -> tuple[float, float]:
    """Return P and Q of the potentials."""
    _, a_s = slowness_factors(speed, medium.c_p, medium.c_s)
    P = 2 * a_s * K_II / (medium.shear_modulus * rayleigh_function(speed, medium.c_p, medium.c_s) * np.sqrt(2 * np.pi))
    return P, (1 + a_s**2) / (2 * a_s) * P


def mode_III(x: Array, y: Array, speed: float, medium: Medium, K_III: float = 1.0) -> tuple[Array, Array, Array]:
    """Return strains xz and yz, and the velocity along z [m/s], of mode III below the shear-wave speed.

    w_x = K_III / (G a_s sqrt(2 pi)) Im z_s^(-1/2), w_y = K_III / (G sqrt(2 pi)) Re z_s^(-1/2)
    (Source: Freund 1990, eq. 4.2.15). Along a line y = h the strain xz is largest at x = -a_s h / sqrt(3).

    Parameters
    ----------
    x, y : ndarray
        From the tip [m].
    K_III : float
        Stress intensity [Pa sqrt(m)].

    Raises
    ------
    RuptfxError
        A speed of c_s or more, or below zero.
    """
    if not 0 <= speed < medium.c_s:
        raise RuptfxError(
            f"near_tip: speed = {speed:.6g} m/s: the fields of mode III need 0 <= speed < c_s = {medium.c_s:.6g} m/s"
        )
    _, a_s = slowness_factors(speed, medium.c_p, medium.c_s)
    f = K_III / (medium.shear_modulus * np.sqrt(2 * np.pi)) * _power(x, a_s * y, -0.5)
    return 0.5 * f.imag / a_s, 0.5 * f.real, -speed * f.imag / a_s


def supershear_exponent(speed: float, medium: Medium) -> float:
    """q of the singularity x^-q of a mode II crack between c_s and c_p.

    tan(pi q) = 4 a_p b / (1 - b^2)^2, b = sqrt(v^2 / c_s^2 - 1): 1/2 at sqrt(2) c_s, where energy flows to the tip as
    below c_R; less elsewhere, where it needs a process zone (Source: Freund 1979; Broberg 1999).

    Raises
    ------
    RuptfxError
        A speed that is not between c_s and c_p.
    """
    if not medium.c_s < speed < medium.c_p:
        raise RuptfxError(
            f"near_tip: speed = {speed:.6g} m/s: supershear is c_s < speed < c_p, {medium.c_s:.6g} to "
            f"{medium.c_p:.6g} m/s"
        )
    a_p, _ = slowness_factors(speed, medium.c_p, medium.c_s)
    b = np.sqrt((speed / medium.c_s) ** 2 - 1)
    return float(np.arctan2(4 * a_p * b, (1 - b**2) ** 2) / np.pi)


def mach_angle(speed: float, medium: Medium) -> float:
    """Angle [rad] between the interface and the shear Mach front, arcsin(c_s / v)."""
    supershear_exponent(speed, medium)  # refuses other speeds
    return float(np.arcsin(medium.c_s / speed))


def mode_II_supershear(x: Array, y: Array, speed: float, medium: Medium, amplitude: float = 1.0) -> Plane2D:
    """Return the field of mode II between c_s and c_p, with the shear Mach front x = -b abs(y).

    phi_xx = P Im z_p^-q; behind the Mach front psi_xx = (1 - b^2) / (2 b) P sin(pi q) abs(x + b abs(y))^-q, odd in y.
    At sqrt(2) c_s there is no Mach front.

    Parameters
    ----------
    x, y : ndarray
        From the tip [m].
    amplitude : float
        sigma_xy = amplitude x^-q ahead of the tip [Pa m^q].
    """
    q = supershear_exponent(speed, medium)
    a_p, _ = slowness_factors(speed, medium.c_p, medium.c_s)
    b = np.sqrt((speed / medium.c_s) ** 2 - 1)
    P = amplitude / (2 * medium.shear_modulus * a_p)
    f = P * _power(x, a_p * y, -q)
    side = np.where(np.signbit(y), -1.0, 1.0)
    behind = np.maximum(-(x + b * np.abs(y)), 0.0)
    with np.errstate(divide="ignore"):
        h = np.where(behind > 0, (1 - b**2) / (2 * b) * P * np.sin(np.pi * q) * behind**-q, 0.0)
    # psi is even in y, hence its mixed derivative odd.
    return _potentials((f.imag, a_p * f.real, -(a_p**2) * f.imag), (h, side * b * h, b**2 * h), speed)


def _power(x: Array, y: Array, power: float) -> Array:
    """(x + i y)^power, cut along negative x."""
    z = np.asarray(x) + 1j * np.asarray(y)
    if (power + 0.5) % 1:
        values: Array = z**power
        return values
    root: Array = np.sqrt(z)  # five times as fast as a power
    return root * z ** int(power - 0.5) if power > 0 else 1 / (root * z ** int(-0.5 - power))


def _mean_power(x: Array, y: Array, power: float, zone: float) -> Array:
    """Mean of (x + s + i y)^power over s from 0 to the length of the zone."""
    if zone <= 0:
        return _power(x, y, power)
    values: Array = (_power(x + zone, y, power + 1) - _power(x, y, power + 1)) / ((power + 1) * zone)
    return values


def strain_extremes(distance: float, K_II: float, speed: float, medium: Medium) -> dict[str, float]:
    """Largest and smallest strains of mode II along a line parallel to the interface.

    Parameters
    ----------
    distance : float
        Of the line, above the interface [m].
    K_II : float
        [Pa sqrt(m)]

    Returns
    -------
    dict
        ``xx_max``, ``xx_min``, ``yy_max``, ``yy_min``, ``xy_max`` and ``xy_min``.
    """
    # All angles, dense: x = h cot(theta). The extremes are flat: 1e4 angles give them to 1e-7.
    angle = np.linspace(0, np.pi, 10002)[1:-1]
    field = mode_II(distance / np.tan(angle), np.full_like(angle, distance), speed, medium, K_II)
    parts = {"xx": field.xx, "yy": field.yy, "xy": field.xy}
    return {
        f"{name}_{which}": float(pick(values))
        for name, values in parts.items() for which, pick in (("max", np.max), ("min", np.min))
    }  # fmt: skip
