"""Indicators in a slip-rate field that the mesh does not resolve the mode or the speed.

The *noise* of a field V is the part of its energy at the shortest wavelength,

    sum (V_i - line through V_i-1 and V_i+1)^2 / (4 sum V_i^2)

which on even points is sin^4(pi / N) for a wave of N points: 1 for two points, 1/16 (`NOISE`) for six; 3/8 for random
numbers. The *mode* is not resolved if

* the median noise behind the tip, over the saved times of its way, is above `NOISE`: the slip rate varies from point
  to point; or
* zones are less than 8 points wide (`NARROW`, in the median) and no wave carries them: the median front behind the tip
  is faster than c_p, in either direction. Points then slip in turn, which is chatter; or
* nothing slides at the saved times from which the mode is read: the rupture passed between two of them.

The *speed of the tip* is not resolved if

* the median noise in the 16 points behind the tip (`NEAR`) is above `NOISE`; or
* it is above c_p, faster than any wave: points slip independently. 2 % (`FIT`) are the error of the fit; or
* more than a quarter (`DISORDER`) of the points start to slide later, by more than a saved time, than a point further
  ahead: many points slip at once.

The *largest slip rate* is not resolved if the noise of the whole record is above that of a wave of eight points,
sin^4(pi / 8) = 0.021 (`PEAK_NOISE`).

The limits lie between runs of the demos whose modes, speeds and peaks stay on half the element size, and those whose
do not. The test is necessary, not sufficient: only a run on a finer mesh proves resolution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.results.analysis.front import Array, tip_position

NOT_RESOLVED = "not resolved"
NOISE, PEAK_NOISE = np.sin(np.pi / 6) ** 4, np.sin(np.pi / 8) ** 4
NEAR = 16  # points behind the tip
NARROW = 8  # points of a zone
DISORDER = 0.25  # of the points
FIT = 1.02  # times c_p


@dataclass(frozen=True)
class Doubts:
    """Reasons why the mode and the speed of the tip are not resolved; empty if they are.

    Attributes
    ----------
    noise : float
        Median noise behind the tip; NaN where nothing was saved on its way.
    mode, speed : tuple of str
    """

    noise: float = np.nan
    mode: tuple[str, ...] = ()
    speed: tuple[str, ...] = ()


def roughness(slip_rate: Array, position: Array) -> tuple[Array, Array]:
    """Return the energy at the shortest wavelength and the whole energy, at every point but the ends [m2/s2].

    The noise is the sum of the first over that of the second.

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
        Slip rate [m/s] with its sign.
    position : ndarray, shape (points,)
        Increasing position [m], evenly spaced or not.

    Returns
    -------
    short, whole : ndarray, shape (times, points - 2)
    """
    share = (position[2:] - position[1:-1]) / (position[2:] - position[:-2])
    line = share * slip_rate[:, :-2] + (1 - share) * slip_rate[:, 2:]
    return (slip_rate[:, 1:-1] - line) ** 2 / 4, slip_rate[:, 1:-1] ** 2


def peak_is_resolved(slip_rate: Array, position: Array) -> bool | None:
    """Return whether the mesh resolves the largest slip rate; None without sliding. See `roughness`."""
    short, total = roughness(slip_rate, position)
    return bool(short.sum() <= PEAK_NOISE * total.sum()) if total.any() else None


def find_doubts(  # noqa: PLR0913
    slip_rate: Array,
    time: Array,
    way: Array,
    arrival: Array,
    window: tuple[float, float],
    *,
    tip_speed: float,
    trailing_speeds: Array,
    zone_points: float,
    c_p: float | None,
) -> Doubts:
    """Return the reasons why mode or tip speed are not resolved, by the rules at the top of this module.

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
        Slip rate [m/s] with its sign, of the points that slid.
    time, way : ndarray, shapes (times,) and (points,)
        Saved times [s] and distances from where the tip starts [m], increasing.
    arrival : ndarray, shape (points,)
        First time of sliding [s].
    window : pair of float
        Part of the way that counts [m].
    tip_speed : float
        [m/s], NaN if there is none.
    trailing_speeds : ndarray
        Of the fronts behind the tip [m/s].
    zone_points : float
        Median number of points of a sliding zone, NaN without any.
    c_p : float, optional
        Of the fastest body [m/s]; without it no speed is too large.
    """
    fastest = FIT * c_p if c_p else np.inf
    tip = tip_position(arrival, way, time)
    rows = np.flatnonzero((tip >= window[0]) & (tip <= window[1]))
    short, total = roughness(slip_rate[rows], way)
    behind = way[1:-1] <= tip[rows, None]
    near = behind & (np.cumsum(behind[:, ::-1], axis=1)[:, ::-1] <= NEAR)
    noise, tip_noise = (_median_noise(short, total, part) for part in (behind, near))
    mode, speed = [], []
    if noise > NOISE:
        mode.append(f"the slip rate varies from point to point ({noise:.0%} of its energy)")
    trailing = np.abs(trailing_speeds[np.isfinite(trailing_speeds)])
    if zone_points < NARROW and len(trailing) and np.median(trailing) > fastest:
        mode.append(f"no wave carries zones of {zone_points:g} points: places slip in turn")
    if np.isnan(zone_points):
        mode.append("nothing slides at the saved times: save more of them")
    if tip_noise > NOISE:
        speed.append(f"the slip rate varies from point to point at the tip ({tip_noise:.0%} of its energy)")
    if tip_speed > fastest:
        speed.append(f"no wave carries a tip of {tip_speed:.4g} m/s: places slip on their own")
    when = arrival[(way >= window[0]) & (way <= window[1]) & np.isfinite(arrival)]
    ahead = np.minimum.accumulate(when[::-1])[::-1]
    if len(when) and np.mean(when > ahead + np.diff(time).max(initial=0)) > DISORDER:
        speed.append("many places slip at once, in no order")
    return Doubts(noise, tuple(mode), tuple(speed))


def _median_noise(short: Array, whole: Array, part: Array) -> float:
    """Return the median noise over the saved times with sliding in that part; NaN without any."""
    energy = (whole * part).sum(axis=1)
    moves = energy > 0
    return float(np.median((short * part).sum(axis=1)[moves] / energy[moves])) if moves.any() else float(np.nan)
