"""Sliding modes: crack-like, pulse, train of pulses, mixed, arrested, none or not resolved, from slip rates alone.

Definitions
-----------
A point *slides* where its slip rate exceeds 2 % (`level`) of the speed of the driven boundary; without a
driven boundary, of the median of the peak slip rates above `quiet`, in runs `output.rupture_threshold`. Before that
the slip rate is replaced by its median over three neighbouring points, so that a single noisy point neither makes
nor splits a zone.

The *reach* is the longest run of neighbouring points that slid at some time; the *tip* at a given time is the
far end of the run of points that slid by then. A *zone* is a run of sliding points; its ends are interpolated
between points. With f the sliding fraction of the interface between the loaded end and the tip and r the
number of zones there, the *pattern* at one time is

    crack   f >= 0.9 and r <= 2
    train   r >= 4
    pulse   f <= 0.4 and r <= 3
    mixed   anything else

The pattern of a run is the one that most saved times show while the tip runs through the second half of its
way, up to 98 % of it (later times hold reflections). A run whose first half is mostly a pulse or a train and
whose second half is a crack is *mixed*: pulses that evolve into a crack. The first 20 % of the way belong to
the loading and do not count.

A run is *arrested* if the tip stopped before the far end and did not move during the last fifth of the time
since sliding began; `pattern` then still tells how it ran. Fewer than five points that slid are *none*.

*Degrees* say without steps how near a run comes to a mode, so that a search can climb: at each of these times

    crack   min(1, f / 0.9) min(1, 2 / r)
    train   min(1, (r - 1) / 3), 0 without sliding
    pulse   min(1, (1 - f) / 0.6) min(1, 3 / r), 0 without sliding

which are 1 where the pattern is met; the degree of the run is their mean over the second half of the way and over both
thresholds. That of pulses that become a crack is the geometric mean of train or pulse, whichever is more, in the first
half, where a single zone counts half, and of crack in the second. A tip that stopped early lowers all of them.

*Confidence* is the share of votes for the pattern: each saved time of the second half votes with its own f
and r at the full and at half the threshold.

Modes and speeds that are the mesh's are *not resolved*: `ruptfx.results.analysis.resolution` says when. What is left
is to be trusted if it also survives a finer mesh, which one run cannot say.

Source of the driven situation and the names of the modes: Coker, Lykotrafitis, Needleman, Rosakis, JMPS 53
(2005).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ruptfx import RuptfxError
from ruptfx.results.analysis.front import (
    TIE,
    Array,
    Speed,
    crossing,
    fit_speed,
    rupture_time,
    tip_position,
    trace_fronts,
)
from ruptfx.results.analysis.resolution import FIT, NOT_RESOLVED, Doubts, find_doubts

LEVEL = 0.02  # of the driven speed: slip-rate threshold of sliding
QUIET = 1e-3  # m/s; default of `output.rupture_threshold`
LOADING, END = 0.2, 0.98  # parts of the tip's way between which modes and speeds are evaluated
MIN_POINTS = 5
DEGREES = ("crack", "pulse", "train", "pulses_into_crack")


@dataclass(frozen=True)
class Modes:
    """Sliding mode of a run; lengths in m, times in s, speeds in m/s, NaN if a quantity does not exist.

    Attributes
    ----------
    mode : str
        crack, pulse, train, mixed, arrested, none or not resolved.
    pattern : str
        The mode before arrest; also set if the mode is not resolved.
    threshold : float
        Slip rate above which a point slides.
    interface_length, reach : float
        Length available to the tip and the part of it that the tip ran through.
    mode_at_half_threshold : str
        The mode found with half the threshold.
    confidence : float
        Share of saved times and thresholds that agree with the pattern; 0 where the mode is not resolved.
    doubts : Doubts
        Reasons why the mode or the speed of the tip is not resolved.
    tip_speed : Speed
        Fitted between 20 % and 98 % of the reach; NaN where it is not resolved.
    regime : str
        sub-Rayleigh, sub-shear (between c_R and c_s), supershear (c_s to c_p) or not resolved; `unknown`
        without speeds.
    sliding_fraction, zones : float
        Medians of f and r while the tip runs through the second half of its way.
    pulse_width, pulse_width_scatter : float
        Median width of the zones away from the loaded end and its relative standard deviation; NaN for a
        crack, and of the first half of the way for pulses that evolve into a crack.
    zone_points : float
        Median number of interface points of a zone.
    pulse_spacing, pulse_spacing_scatter : float
        Median distance between the centres of neighbouring zones and its relative standard deviation.
    healing_time : float
        Median duration of the first sliding of a point; NaN if most points never stopped.
    trailing_speeds : ndarray
        Speeds of the fronts behind the tip that ran through a tenth of the reach, in order.
    degrees : dict of float
        Degree, from 0 to 1, of each of crack, pulse, train and pulses_into_crack.
    speeds : dict of float
        c_R, c_s, c_p and the fastest wave where the speed of the tip is fitted: one over the mean slowness [m/s].
    """

    mode: str
    pattern: str
    threshold: float
    interface_length: float
    reach: float = 0.0
    mode_at_half_threshold: str = "unknown"
    confidence: float = 1.0
    doubts: Doubts = field(default_factory=Doubts)
    tip_speed: Speed = field(default_factory=Speed)
    regime: str = "unknown"
    sliding_fraction: float = 0.0
    zones: float = 0.0
    pulse_width: float = np.nan
    pulse_width_scatter: float = np.nan
    zone_points: float = np.nan
    pulse_spacing: float = np.nan
    pulse_spacing_scatter: float = np.nan
    healing_time: float = np.nan
    trailing_speeds: Array = field(default_factory=lambda: np.array([]))
    degrees: dict[str, float] = field(default_factory=lambda: dict.fromkeys(DEGREES, 0.0))
    speeds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Zones:
    """Every sliding zone at every saved time: row of the time, ends [m], number of points; shape (zones,)."""

    row: Array
    start: Array
    stop: Array
    points: Array

    @property
    def width(self) -> Array:
        return self.stop - self.start


def classify(  # noqa: PLR0913
    slip_rate: Array,
    time: Array,
    position: Array,
    *,
    loaded_end: float | None = None,
    V_imp: float | None = None,
    c_R: float | Array | None = None,
    c_s: float | Array | None = None,
    c_p: float | Array | None = None,
    fastest: float | Array | None = None,
    level: float = LEVEL,
    quiet: float = QUIET,
) -> Modes:
    """Classify the sliding of one run; see the definitions at the top of this module.

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
        Slip rate [m/s], of either sign.
    time, position : ndarray, shapes (times,) and (points,)
        Saved times [s] and positions along the interface [m], both increasing.
    loaded_end : float, optional
        Position from which the rupture runs [m]: the driven end, or the nucleation point. Inside the
        interface the side that slides further is classified. Default: the left end.
    V_imp : float, optional
        Speed of the driven boundary [m/s].
    c_R, c_s, c_p : float or ndarray, shape (points,), optional
        Wave speeds along the interface [m/s], to name the speed regime; of different bodies those of the slower one.
    fastest : float or ndarray, shape (points,), optional
        Speed of the fastest wave [m/s]; no tip is faster. Default: `c_p`.
    level : float
        Threshold as a fraction of `V_imp`.
    quiet : float
        Without `V_imp` the threshold is a fraction of the median of the largest slip rates of the points that are
        faster than this [m/s].

    Raises
    ------
    RuptfxError
        The shapes do not fit together, or time or position do not increase.
    """
    _check(slip_rate, time, position)
    origin = position[0] if loaded_end is None else loaded_end
    magnitude = median3(np.abs(slip_rate))
    side, distance = _away(magnitude, time, position, origin, _reference(slip_rate, V_imp, quiet) * level)
    rate = magnitude[:, side]
    threshold = level * _reference(rate, V_imp, quiet)
    full = _at_threshold(rate, time, distance, threshold)
    half = _at_threshold(rate, time, distance, threshold / 2)
    # The votes of both thresholds count equally.
    confidence = float(np.mean([np.mean(item.votes == full.modes.pattern) for item in (full, half)]))
    reach = full.modes.reach
    entries = {"c_R": c_R, "c_s": c_s, "c_p": c_p, "fastest": c_p if fastest is None else fastest}
    speeds = {name: _on_the_way(value, side, distance, reach) for name, value in entries.items() if value is not None}
    c_s = speeds.get("c_s")
    slowest = 0.1 * (c_s or np.ptp(distance) / np.ptp(time))
    inside = distance - distance[0] <= (1 + TIE) * reach
    fronts = trace_fronts(rate[:, inside], time, distance[inside], threshold, slowest, 0.1 * reach)
    trailing = np.array([fit_speed(front.distance, front.time).value for front in fronts[1:]])
    result = replace(
        full.modes,
        mode_at_half_threshold=half.modes.mode,
        confidence=confidence,
        regime=regime(full.modes.tip_speed.value, speeds.get("c_R"), c_s, speeds.get("fastest")),
        trailing_speeds=trailing,
        speeds=speeds,
        degrees={name: (full.modes.degrees[name] + half.modes.degrees[name]) / 2 for name in DEGREES},
    )
    if result.pattern == "none":
        return result
    doubts = find_doubts(
        slip_rate[:, side[inside]], time, distance[inside] - distance[0],
        rupture_time(rate[:, inside], time, threshold), (LOADING * reach, END * reach),
        tip_speed=result.tip_speed.value, trailing_speeds=trailing, zone_points=result.zone_points,
        c_p=speeds.get("fastest"),
    )  # fmt: skip
    return _without_what_is_not_resolved(replace(result, doubts=doubts))


def _on_the_way(speed: float | Array, side: Array, distance: Array, reach: float) -> float:
    """Return one over the mean slowness of a wave where the speed of the tip is fitted [m/s]; without reach of all."""
    if np.ndim(speed) == 0:
        return float(speed)
    way, slowness = distance - distance[0], 1 / np.asarray(speed)[side]
    low, high = (LOADING - TIE) * reach, (END + TIE) * reach
    inside = (way >= low) & (way <= high) if reach > 0 else np.ones(len(way), dtype=bool)
    if np.count_nonzero(inside) < 2:
        return float(1 / slowness[inside if inside.any() else slice(None)].mean())
    return float(np.ptp(way[inside]) / np.trapezoid(slowness[inside], way[inside]))


def _without_what_is_not_resolved(modes: Modes) -> Modes:
    if modes.doubts.mode:
        modes = replace(modes, mode=NOT_RESOLVED, mode_at_half_threshold=NOT_RESOLVED, confidence=0.0)
    if modes.doubts.speed:
        modes = replace(modes, tip_speed=Speed(points=modes.tip_speed.points), regime=NOT_RESOLVED)
    return modes


def regime(speed: float, c_R: float | None, c_s: float | None, c_p: float | None) -> str:
    """Return the name of a rupture speed among the wave speeds; speeds above c_p (with the fit error) are not resolved.

    In antiplane motion all three are c_s, and a slower rupture is sub-shear.
    """
    if not (c_R and c_s and c_p) or not np.isfinite(speed):
        return "unknown"
    limits = {"sub-Rayleigh": c_R if c_R < c_s else 0.0, "sub-shear": c_s, "supershear": FIT * c_p}
    return next((name for name, limit in limits.items() if speed <= limit), NOT_RESOLVED)


def median3(values: Array) -> Array:
    """Return the median over each point and its two neighbours along the last axis; ends keep their value."""
    if values.shape[-1] < 3:
        return values
    left, mid, right = values[..., :-2], values[..., 1:-1], values[..., 2:]
    inner = np.maximum(np.minimum(left, mid), np.minimum(np.maximum(left, mid), right))
    return np.concatenate([values[..., :1], inner, values[..., -1:]], axis=-1)


def find_zones(slip_rate: Array, distance: Array, threshold: float) -> Zones:
    """Return all runs of sliding points at all times; ends interpolated between points (`crossing`).

    Parameters
    ----------
    slip_rate : ndarray, shape (times, points)
        Magnitude of the slip rate [m/s].
    distance : ndarray, shape (points,)
        Increasing distance [m].
    threshold : float
        Slip rate [m/s] above which a point slides.
    """
    slides = np.pad(slip_rate > threshold, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(slides, axis=1)
    row, first = np.nonzero(change == 1)
    last = np.nonzero(change == -1)[1] - 1

    def end(inside: Array, outside: Array) -> Array:
        # At the end of the interface both are the same point.
        part = crossing(slip_rate[row, outside], slip_rate[row, inside], threshold)
        return distance[outside] + part * (distance[inside] - distance[outside])

    start = end(first, np.maximum(first - 1, 0))
    stop = end(last, np.minimum(last + 1, len(distance) - 1))
    return Zones(row, start, stop, last - first + 1)


@dataclass(frozen=True)
class _Classified:
    modes: Modes
    votes: Array  # pattern at each saved time of the second half


def _at_threshold(rate: Array, time: Array, distance: Array, threshold: float) -> _Classified:
    """Compute everything except fronts and confidence at one threshold."""
    length = float(np.ptp(distance))
    first, last = _longest_run((rate > threshold).any(axis=0))
    if last - first < MIN_POINTS:
        return _Classified(Modes("none", "none", threshold, length), np.array(["none"]))

    run = slice(first, last)
    arrival = rupture_time(rate[:, run], time, threshold)
    tip = tip_position(arrival, distance[run], time) - distance[0]
    reach = float(distance[last - 1] - distance[0])
    zones = find_zones(rate[:, :last], distance[:last], threshold)
    fraction, count = _fraction_and_count(zones, tip, distance[0])
    early = np.flatnonzero((tip >= LOADING * reach) & (tip < reach * (LOADING + END) / 2))
    late = np.flatnonzero((tip >= reach * (LOADING + END) / 2) & (tip <= END * reach))
    late = late if len(late) else np.flatnonzero(tip >= 0)[-1:]
    votes = _pattern(fraction[late], count[late])
    pattern, before = _most(votes), _most(_pattern(fraction[early], count[early]))
    evolves = before in ("pulse", "train") and pattern == "crack"
    if evolves:
        pattern, votes = "mixed", np.where(votes == "crack", "mixed", votes)

    chosen = np.isin(zones.row, early if evolves else late)
    # A zone at the loaded end may be an incipient pulse or no pulse.
    born = chosen & (zones.start > distance[0])
    width, points = zones.width[born if born.any() else chosen], zones.points[chosen]
    gap = np.diff((zones.start + zones.stop)[chosen] / 2)[np.diff(zones.row[chosen]) == 0]
    single = pattern == "crack"
    way = _share_of_time(tip, time, reach, length)
    degrees = {name: way * degree for name, degree in _degrees(fraction, count, early, late).items()}
    modes = Modes(
        mode="arrested" if way < 1 else pattern,
        degrees=degrees,
        pattern=pattern,
        threshold=threshold,
        reach=reach,
        interface_length=length,
        tip_speed=fit_speed(distance[run] - distance[0], arrival, LOADING * reach, END * reach),
        sliding_fraction=float(np.median(fraction[late])),
        zones=float(np.median(count[late])),
        pulse_width=np.nan if single else _median(width),
        pulse_width_scatter=np.nan if single else _scatter(width),
        zone_points=_median(points),
        pulse_spacing=np.nan if single else _median(gap),
        pulse_spacing_scatter=np.nan if single else _scatter(gap),
        healing_time=_healing_time(rate[:, run], time, threshold),
    )
    return _Classified(modes, votes)


def _fraction_and_count(zones: Zones, tip: Array, origin: float) -> tuple[Array, Array]:
    """Return the sliding fraction f between loaded end and tip, and the number of zones r, per saved time."""
    length = np.bincount(zones.row, zones.width, minlength=len(tip))
    count = np.bincount(zones.row, minlength=len(tip))
    # The far end of the zones and the interpolated tip differ by less than a point: take the farther.
    furthest = np.zeros(len(tip))
    np.maximum.at(furthest, zones.row, zones.stop - origin)
    span = np.fmax(tip, furthest)
    return np.divide(length, span, out=np.zeros(len(tip)), where=span > 0), count


def _pattern(f: Array, r: Array) -> Array:
    rules = [(f >= 0.9) & (r <= 2), r >= 4, (f <= 0.4) & (r <= 3)]
    return np.select(rules, ["crack", "train", "pulse"], "mixed")


def _degrees(f: Array, r: Array, early: Array, late: Array) -> dict[str, float]:
    """Return the degree of each mode in the two halves of the way, given as rows of saved times."""
    zones = np.maximum(r, 1)
    crack = np.minimum(f / 0.9, 1) * np.minimum(2 / zones, 1)
    train = np.minimum((zones - 1) / 3, 1)
    pulse = (r > 0) * np.minimum((1 - f) / 0.6, 1) * np.minimum(3 / zones, 1)
    several = np.maximum(train, pulse * np.where(r > 1, 1.0, 0.5))
    at_first = float(np.mean(several[early])) if len(early) else 0.0
    entries = {"crack": crack[late].mean(), "pulse": pulse[late].mean(), "train": train[late].mean()}
    return {name: float(value) for name, value in entries.items()} | {
        "pulses_into_crack": float(np.sqrt(at_first * entries["crack"]))
    }


def _most(patterns: Array) -> str:
    """Return the most frequent pattern; mixed if there is none."""
    names, counts = np.unique(patterns, return_counts=True)
    return str(names[counts.argmax()]) if len(names) else "mixed"


def _share_of_time(tip: Array, time: Array, reach: float, length: float) -> float:
    """Return the fraction of the sliding time in which the tip moved, over 4/5."""
    if reach >= END * length:
        return 1.0
    started, reached = np.flatnonzero(tip >= 0)[0], np.flatnonzero(tip >= reach)
    ran = (time[reached[0]] if len(reached) else time[-1]) - time[started]
    duration = time[-1] - time[started]
    return float(min(1.0, ran / (0.8 * duration))) if duration > 0 else 1.0


def _healing_time(rate: Array, time: Array, threshold: float) -> float:
    """Return the median duration of the first sliding of each point [s]; NaN if most points never stopped."""
    start = rupture_time(rate, time, threshold)
    # Time reversed, the end of sliding is an onset; the first one after the start is the earliest that
    # follows it.
    slides = rate > threshold
    later = np.cumsum(slides, axis=0) > 0
    row = np.argmax(later & ~slides, axis=0)
    column = np.flatnonzero(row > 0)
    if 2 * len(column) < np.isfinite(start).sum():
        return float(np.nan)
    row = row[column]
    part = crossing(rate[row, column], rate[row - 1, column], threshold)
    end = time[row] - part * (time[row] - time[row - 1])
    return float(np.median(end - start[column]))


def _longest_run(flags: Array) -> tuple[int, int]:
    """Return the first and one past the last index of the longest run of True."""
    change = np.diff(np.pad(flags, 1).astype(np.int8))
    starts, stops = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])


def _reference(rate: Array, V_imp: float | None, quiet: float) -> float:
    """Return the slip rate of which thresholds are fractions [m/s]."""
    if V_imp:
        return abs(V_imp)
    peak = np.abs(rate).max(axis=0)
    slid = peak > quiet
    return float(np.median(peak[slid])) if slid.any() else quiet / LEVEL


def _away(rate: Array, time: Array, position: Array, origin: float, threshold: float) -> tuple[Array, Array]:
    """Return the points on the side of the origin that slides further, ordered away from it, with distances.

    Where both slide as far it is the side with more slip, and that of increasing positions if there is no difference.
    """
    sides = []
    for sign in (1, -1):
        side = np.flatnonzero(sign * (position - origin) >= -TIE * np.ptp(position))[::sign]
        if len(side) >= MIN_POINTS:
            sides.append((side, sign * (position[side] - origin)))
    if not sides:
        raise RuptfxError(
            f"modes: fewer than {MIN_POINTS} interface points on either side of origin = {origin:g} m; refine the mesh"
        )
    # A point within 1e-3 of the threshold counts in part, so that rounding at one point does not decide.
    shares = np.clip(1 + (rate.max(axis=0) / threshold - 1) / 1e-3, 0.0, 1.0)
    length, steps = np.gradient(position), np.diff(time)
    slip = 0.5 * steps @ (rate[1:] + rate[:-1])
    for measure in (shares * length, slip * length):
        sizes = [float(measure[side].sum()) for side, _ in sides]
        sides = [each for each, size in zip(sides, sizes, strict=True) if size >= (1 - TIE) * max(sizes)]
    return sides[0]


def _check(slip_rate: Array, time: Array, position: Array) -> None:
    if slip_rate.shape != (len(time), len(position)):
        expected = (len(time), len(position))
        raise RuptfxError(f"modes: slip_rate has shape {slip_rate.shape}, not (times, points) = {expected}")
    if len(time) < 1 or len(position) < MIN_POINTS:
        raise RuptfxError(f"modes: one time and {MIN_POINTS} points are the least, got {slip_rate.shape}")
    if (np.diff(time) <= 0).any() or (np.diff(position) <= 0).any():
        raise RuptfxError("modes: time and position must increase")


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else float(np.nan)


def _scatter(values: Array) -> float:
    return float(np.std(values) / np.mean(values)) if len(values) > 1 else float(np.nan)
