"""Fracture energy of a moving front, from the fields around it and from what happens at the interface.

`j_integral` counts the energy that flows through a contour to the tip of a steady front, `domain_integral` that to the
tip of any front, `breakdown` the work of the stress above its residual at a point; all are the fracture energy of a
front with a process zone that is small. `process_zone` is how long the traction of a point falls, as a length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx import RuptfxError
from ruptfx.results.analysis.near_tip import Medium

Array = np.ndarray


def j_integral(contour: Array, stress: Array, velocity: Array, speed: float, medium: Medium) -> float:
    """Return the energy release of a front that runs along x, from a contour above the interface [J/m2].

    G = (2 / v) int [sigma_ij n_j v_i + (U + T) v n_x] ds, U and T the densities of strain and kinetic energy, twice for
    the mirror image below (Source: Freund 1990, eq. 5.2.7). The contour moves with the tip; on another one it is the
    same where the front is steady.

    Parameters
    ----------
    contour : ndarray, shape (n, 2)
        From the interface ahead of the tip to that behind it, anticlockwise [m].
    stress : ndarray, shape (n, 3)
        xx, yy, xy [Pa], minus the residual stress behind the front, so that work against friction is excluded.
    velocity : ndarray, shape (n, 2)
        [m/s]
    speed : float
        [m/s]

    Raises
    ------
    RuptfxError
        If the shapes of the arrays differ.
    """
    if len(contour) < 3 or stress.shape != (len(contour), 3) or velocity.shape != contour.shape:
        raise RuptfxError(
            f"j_integral: contour {contour.shape}, stress {stress.shape} and velocity {velocity.shape} must be (n, 2), "
            "(n, 3) and (n, 2) with at least three points"
        )
    xx, yy, xy = stress.T
    shear = medium.shear_modulus
    # Of plane stress or strain: sigma_xx - sigma_yy = 2 G (e_xx - e_yy), sigma_xx + sigma_yy = 2 (lambda + G) (e_xx +
    # e_yy), lambda + G = G (c_p^2 / c_s^2 - 1).
    bulk = shear * ((medium.c_p / medium.c_s) ** 2 - 1)
    energy = (xx + yy) ** 2 / (8 * bulk) + ((xx - yy) ** 2 + 4 * xy**2) / (8 * shear)
    energy = energy + 0.5 * medium.density * np.sum(velocity**2, axis=1)
    # n ds is (dy, -dx) anticlockwise.
    along_x = xx * velocity[:, 0] + xy * velocity[:, 1] + energy * speed
    along_y = xy * velocity[:, 0] + yy * velocity[:, 1]
    step = np.diff(contour, axis=0)
    flow = 0.5 * (along_x[1:] + along_x[:-1]) @ step[:, 1] - 0.5 * (along_y[1:] + along_y[:-1]) @ step[:, 0]
    return float(2 * flow / speed)


@dataclass(frozen=True)
class Moment:
    """Motion at one instant at points above the interface, in plane strain or stress.

    Attributes
    ----------
    point : ndarray, shape (n, 2)
        [m]
    area : ndarray, shape (n,)
        Tributary area of each point [m2].
    gradient : ndarray, shape (n, 2, 2)
        du_i/dx_j as [n, j, i], including that of the initial stress, minus that of the residual state [1].
    velocity, acceleration : ndarray, shape (n, 2)
        [m/s], [m/s2]
    spin : ndarray, shape (n, 2)
        dv_i/dx [1/s].
    """

    point: Array
    area: Array
    gradient: Array
    velocity: Array
    acceleration: Array
    spin: Array


def domain_integral(moment: Moment, tip: float, half_width: float, medium: Medium) -> float:
    """Return the energy release of any front, steady or not, from the motion in a box around its tip [J/m2].

    G = 2 int [(sigma_ij u_i,x - (U + T) delta_xj) q_,j + rho (a_i u_i,x - v_i v_i,x) q] dA above the interface, with a
    weight q that is one in the inner half of the box and falls to zero at its sides: `j_integral` on all contours
    between, less what feeds the energy inside of each (Source: Nakamura, Shih and Freund 1985, Int. J. Fract. 27, 229).

    Parameters
    ----------
    moment : Moment
        With points that fill the box.
    tip, half_width : float
        Middle of the box, half its length and its height [m]; the inner half must hold the process zone.
    """
    away = (moment.point - [tip, 0.0]) / half_width
    side, top = np.clip(2 * (1 - np.abs(away)), 0.0, 1.0).T
    slope = np.where((np.abs(away) > 0.5) & (np.abs(away) < 1), -2 * np.sign(away), 0.0) / half_width
    weight, q_x, q_y = side * top, slope[:, 0] * top, side * slope[:, 1]
    along = moment.gradient[:, 0]  # u_i,x
    stress, strain_energy = _stress(moment.gradient, medium)
    total = strain_energy + 0.5 * medium.density * np.sum(moment.velocity**2, axis=1)
    flow_x = stress[:, 0] * along[:, 0] + stress[:, 2] * along[:, 1] - total
    flow_y = stress[:, 2] * along[:, 0] + stress[:, 1] * along[:, 1]
    fed = np.sum(moment.acceleration * along - moment.velocity * moment.spin, axis=1)
    return float(2 * moment.area @ (flow_x * q_x + flow_y * q_y + medium.density * fed * weight))


def _stress(gradient: Array, medium: Medium) -> tuple[Array, Array]:
    """Return xx, yy, xy [Pa] and the density of strain energy [J/m3]."""
    xx, yy, shear = gradient[:, 0, 0], gradient[:, 1, 1], gradient[:, 0, 1] + gradient[:, 1, 0]
    lame = medium.shear_modulus * ((medium.c_p / medium.c_s) ** 2 - 2)
    parts = 2 * medium.shear_modulus * np.column_stack([xx, yy, 0.5 * shear])
    parts[:, :2] += (lame * (xx + yy))[:, None]
    return parts, 0.5 * (parts[:, 0] * xx + parts[:, 1] * yy + parts[:, 2] * shear)


@dataclass(frozen=True)
class Breakdown:
    """Fall of the traction at one point.

    Attributes
    ----------
    energy : float
        int (T - T_residual) ds until the residual is reached [J/m2].
    peak, residual : float
        Traction [Pa].
    slip : float
        Slip at which the residual is reached [m].
    start, stop : float
        Times of the peak and of the residual [s].
    """

    energy: float
    peak: float
    residual: float
    slip: float
    start: float
    stop: float


def breakdown(time: Array, traction: Array, slip: Array, residual: float | None = None) -> Breakdown:
    """Return the local stress drop of a point and the area under its traction-slip curve above the residual.

    Parameters
    ----------
    time, traction, slip : ndarray, shape (times,)
        At a point of the interface: s, Pa, m.
    residual : float, optional
        Residual traction [Pa]; default: the smallest value after the peak.

    Raises
    ------
    RuptfxError
        If the point did not slip.
    """
    size, way = np.abs(traction), np.abs(slip - slip[0])
    peak = int(np.argmax(size))
    if not way[-1] > 0 or peak == len(size) - 1:
        raise RuptfxError(
            "breakdown: the traction did not fall: the front did not pass the point in this time; choose a point "
            "nearer to where it began, or a longer run"
        )
    least = float(size[peak:].min()) if residual is None else residual
    # The residual counts as reached within 1 % of the drop: some laws approach it asymptotically.
    down = size[peak:] <= least + 0.01 * (size[peak] - least)
    if not down.any():
        raise RuptfxError(
            f"breakdown: the traction fell to {size[peak:].min():.6g} Pa, not to residual = {least:.6g} Pa; leave "
            "residual out, or take a longer run"
        )
    end = peak + int(np.argmax(down)) + 1
    above = np.maximum(size[:end] - least, 0.0)
    energy = float(0.5 * (above[1:] + above[:-1]) @ np.diff(way[:end]))
    return Breakdown(energy, float(size[peak]), least, float(way[end - 1]), float(time[peak]), float(time[end - 1]))


def process_zone(fall: Breakdown, speed: float) -> float:
    """Return the length over which the traction falls behind a front [m]."""
    return speed * (fall.stop - fall.start)
