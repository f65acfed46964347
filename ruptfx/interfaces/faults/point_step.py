"""The step of a contact point, written once: from a trial traction to the one that contact and friction admit.

    normal:  sigma = max(trial_n, 0); the excess of the trial opens the gap
    shear:   find V >= 0 with T + Z V = trial, T parallel to the slip rate at its own time and |T| = strength(V)

V is the mean slip rate of the step. The strength belongs to the time of the traction, at which the slip rate is a sum
of V and V_before; with two tangents the slip rate may rotate, and each may have its own impedance Z_i. The contribution
of the previous step is added to the trial, trial' = trial + k Z V_before, so that with the unit vector d along the
traction (strength + Z_i (V + k V_before)) d_i = trial'_i. The scalar equation is

    N(V) = |trial'_i / (strength + Z_i (V + k V_before))| = 1

V is bracketed by 0 and by the V of zero traction, and computed by Newton steps in V or in the logarithm of the rate in
the law, whichever fits, with bisection as a fallback.

All functions are pointwise NumPy without branches on values, like friction laws. Called with arrays they compute
(`projection.py`); traced they become C for lanes and scalars and exact derivatives with their transposes
(`adjoint/point_map.py`). Only loops are written per language. Vectors have one entry per tangent.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from ruptfx.input.fields import Array
from ruptfx.laws.friction import AT_REST

TOLERANCE = 1e-13  # of the trial traction
BALANCED = 1e-9  # of the trial traction: residual accepted if V has no more significant bits
NARROW = 1e-15  # width of a bracket over its end at which V has no more significant bits
MAX_ITERATIONS = 100
BISECT_EVERY = 8
Vector = Sequence[Any]
"""An `Array` per tangent."""


def normal_stress(trial: Array, tension: Array | None = None, softness: Array = 0.0) -> Any:
    """Return the admissible normal stress of a trial one, compression positive [Pa].

    Parameters
    ----------
    tension : largest tension that cohesion carries, on the secant to the origin [Pa]; default: no cohesion.
    softness : largest opening over the compliance of the trial [Pa].
    """
    if tension is None:
        return np.where(trial > 0, trial, 0.0)
    carried = -trial * np.where(tension > 0, tension / (tension + softness), 0.0)
    return np.where(trial > 0, trial, 0.0 - np.where(carried < tension, carried, tension))


@dataclass(frozen=True)
class ShiftedTrial:
    """The trial shear traction with the contribution of the previous step.

    Attributes
    ----------
    shear : trial' [Pa], per tangent.
    impedance : Z [Pa s/m], per tangent.
    shift : k V_before [m/s], per tangent; zero where a point does not continue to slide.
    size, direction : length of trial' [Pa], and its unit vector, zero without a length.
    rate_before : V_before along the direction [m/s].
    shift_along : k V_before along the direction [m/s].
    free_velocity : trial' / Z, the slip rate that leaves no traction, including the shift [m/s], per tangent.
    free_direction : its unit vector.
    free_rate : V that leaves no traction [m/s].
    mean_impedance : impedance along the direction [Pa s/m].
    """

    shear: Vector
    impedance: Vector
    shift: Vector
    size: Any
    direction: Vector
    rate_before: Any
    shift_along: Any
    free_velocity: Vector
    free_direction: Vector
    free_rate: Any
    mean_impedance: Any


def shifted_trial(shear: Vector, impedance: Vector, before: Vector, weight: Array) -> ShiftedTrial:
    """Return the trial of the scalar equation.

    Parameters
    ----------
    shear, impedance : trial shear traction [Pa] and Z [Pa s/m].
    before : mean slip rate of the previous step [m/s].
    weight : k, weight of V_before over that of V in the slip rate at the traction (`TracedLaw.carried`).
    """
    # A point whose trial traction opposes its slip rate stops before it reverses.
    continues = dot(before, shear) > 0
    # With k < 0, a shift of more than half of the trial could reverse the direction of the traction.
    shift_square = total((weight * z * v) ** 2 for z, v in zip(impedance, before, strict=True))
    is_small = (weight > 0) | (4 * shift_square <= dot(shear, shear))
    k = np.where(continues & is_small, weight, 0.0)
    shift = [k * v for v in before]
    shifted = [t + z * v for t, z, v in zip(shear, impedance, shift, strict=True)]
    size = length(shifted)
    direction = unit(shifted, size)
    shift_along = dot(shift, direction)
    # A step of zero length has no impedance, and no slip.
    free = [np.where(z > 0, t / z, 0.0) for t, z in zip(shifted, impedance, strict=True)]
    speed = length(free)
    return ShiftedTrial(
        shear=shifted,
        impedance=impedance,
        shift=shift,
        size=size,
        direction=direction,
        rate_before=np.where(continues, dot(before, direction), 0.0),
        shift_along=shift_along,
        free_velocity=free,
        free_direction=direction if len(shear) == 1 else unit(free, speed),
        free_rate=np.where(speed > 0, speed - shift_along, 0.0),
        mean_impedance=impedance[0]
        if len(shear) == 1
        else total(d * d * z for d, z in zip(direction, impedance, strict=True)),
    )


@dataclass(frozen=True)
class Balance:
    """The scalar equation at a slip rate.

    Attributes
    ----------
    residual : Q (N - 1) [Pa], zero at the root, where Q = |trial'| if the impedances are equal.
    slope : minus the derivative of the residual with respect to V, at the root [Pa s/m].
    direction : unit vector of the traction, per tangent.
    """

    residual: Any
    slope: Any
    direction: Vector


def balance(trial: ShiftedTrial, rate: Array, strength: Array, strength_slope: Array) -> Balance:
    """Return residual, slope and direction at a slip rate V.

    Parameters
    ----------
    rate : V [m/s].
    strength, strength_slope : strength at V [Pa], and its derivative [Pa s/m].
    """
    sliding: Any = rate + trial.shift_along
    if len(trial.shear) == 1:
        (z,) = trial.impedance
        return Balance(trial.size - z * sliding - strength, strength_slope + z, trial.direction)
    resistance = [strength + z * sliding for z in trial.impedance]
    ratio = [t / q for t, q in zip(trial.shear, resistance, strict=True)]
    norm = np.sqrt(dot(ratio, ratio))
    direction = [r / norm for r in ratio]
    share = [d * d for d in direction]
    mean = dot(share, resistance)
    slopes = ((strength_slope + z) / q for z, q in zip(trial.impedance, resistance, strict=True))
    return Balance(mean * (norm - 1), mean * total(s * each for s, each in zip(share, slopes, strict=True)), direction)


@dataclass(frozen=True)
class Iterate:
    """An iterate of V.

    Attributes
    ----------
    rate : V [m/s]; where the iteration has ended the root, not a number without one.
    low, high : bracket of the root [m/s].
    direction : unit vector of the traction, per tangent.
    goes_on : condition, False where the iteration has ended.
    """

    rate: Any
    low: Any
    high: Any
    direction: Vector
    goes_on: Any


def least_strength(trial: ShiftedTrial, normal_stress: Array) -> Any:
    """Return the strength [Pa] below which it is negative beyond rounding, and would drive slip."""
    return -TOLERANCE * (trial.size + normal_stress)


def first_iterate(
    trial: ShiftedTrial, trial_normal: Array, normal_stress: Array, strength_at_rest: Any, guess: Array, is_closed: Any
) -> Iterate:
    """Return the first iterate, of which points that are stuck or open are ended.

    Parameters
    ----------
    trial_normal, normal_stress : trial and admissible normal stress [Pa].
    strength_at_rest : [Pa]
    guess : V to begin with [m/s], where it is in the bracket.
    is_closed : condition
    """
    free = trial.free_rate
    excess = trial.size - trial.mean_impedance * trial.shift_along - strength_at_rest
    yields = is_closed & (excess > 0) & (free > 0)
    linear = excess / trial.mean_impedance
    start = np.where((guess > 0) & (guess < free), guess, np.where(linear < free, linear, free))
    is_sound = np.isfinite(trial.size + trial_normal + strength_at_rest) & (
        np.logical_not(is_closed) | (strength_at_rest >= least_strength(trial, normal_stress))
    )
    rate = np.where(is_sound, np.where(yields, start, np.where(is_closed, 0.0, free)), np.nan)
    direction = trial.direction
    if len(direction) > 1:
        direction = [np.where(is_closed, *each) for each in zip(direction, trial.free_direction, strict=True)]
    return Iterate(rate, np.zeros_like(free), free, direction, is_sound & yields)


def next_iterate(
    last: Iterate, trial: ShiftedTrial, normal_stress: Array, strength: Any, strength_slope: Any, spread: Any,
    bisects: Any,
) -> Iterate:  # fmt: skip
    """Return the iterate after one with known strength; points that have ended do not change.

    Parameters
    ----------
    strength, strength_slope : strength at the last V [Pa], and its derivative [Pa s/m].
    spread : change of V over that of the logarithm of the slip rate at the traction [m/s].
    bisects : condition, whether the bracket is divided.
    """
    at, rate, active = balance(trial, last.rate, strength, strength_slope), last.rate, last.goes_on
    is_number, size = np.logical_not(np.isnan(at.residual)), np.abs(at.residual)
    low, high = np.where(at.residual > 0, rate, last.low), np.where(at.residual > 0, last.high, rate)
    rests = (high <= AT_REST) & is_number  # with the trial traction
    # A strength with a jump, or a negative one, has no root where the bracket ends.
    ends = (high - low <= NARROW * high) & (size <= BALANCED * trial.size)
    done = (size <= TOLERANCE * trial.size) | ends | rests
    following = next_rate(rate, low, high, at.residual, at.slope, trial.mean_impedance, spread, bisects)
    # A strength that is not a number must not be mistaken for a converged one.
    following = np.where(is_number, following, np.nan)
    root = np.where(rests, 0.0, np.where(strength < least_strength(trial, normal_stress), np.nan, rate))
    direction = last.direction
    if len(direction) > 1:
        direction = [np.where(active, *each) for each in zip(at.direction, direction, strict=True)]
    return Iterate(
        rate=np.where(active, np.where(done, root, following), rate),
        low=np.where(active, low, last.low),
        high=np.where(active, high, last.high),
        direction=direction,
        goes_on=active & np.logical_not(done) & is_number,
    )


def next_rate(  # noqa: PLR0913
    rate: Any, low: Any, high: Any, residual: Any, slope: Any, impedance: Any, spread: Any, bisects: Any
) -> Any:
    """Return the next V: a Newton step in V where the impedance dominates, in the logarithm of the rate elsewhere.

    Bisection (in the logarithm if the bracket spans decades) if the step leaves the bracket, and occasionally, because
    the two kinds of Newton steps may cycle. Parameters as for `Balance` and `next_iterate`.
    """
    logarithmic = rate + spread * np.expm1(residual / (slope * spread))
    step = np.where(slope > 2 * impedance, logarithmic, rate + residual / slope)
    least = 1e-12 * high
    geometric = np.sqrt(np.where(low > least, low, least) * high)
    middle = np.where(low > 1e-3 * high, 0.5 * (low + high), geometric)
    return np.where((step > low) & (step < high) & np.logical_not(bisects), step, middle)


@dataclass(frozen=True)
class Sliding:
    """Slip rates and shear traction of a step, per tangent.

    Attributes
    ----------
    mean_slip_rate : of the step [m/s].
    slip_rate : at the time of the traction [m/s].
    shear_traction : [Pa]
    """

    mean_slip_rate: Vector
    slip_rate: Vector
    shear_traction: Vector


def sliding(  # noqa: PLR0913
    trial: ShiftedTrial, shear: Vector, before: Vector, rate: Array, rate_now: Array, direction: Vector, *,
    is_open: Any, is_stuck: Any, at_end: bool,
) -> Sliding:  # fmt: skip
    """Return slip rates and traction of a point from V and the direction of its traction.

    Parameters
    ----------
    shear : trial shear traction without the shift [Pa].
    before : mean slip rate of the previous step [m/s].
    rate, rate_now : V, and the slip rate at the time of the traction [m/s].
    direction : unit vector of the traction, of the free slip rate at open points.
    is_open, is_stuck : conditions; a stuck point is closed and has V = 0.
    at_end : whether V is that of the step which ends with the traction (`TracedLaw`).
    """
    sums = [(rate + trial.shift_along) * d for d in direction]
    now = [rate_now * d for d in direction]
    # Open points without size and direction, which have a kink at zero traction; the slip rate has none.
    sums = [np.where(is_open, free, v) for free, v in zip(trial.free_velocity, sums, strict=True)]
    if not at_end:  # V + V_before is the free slip rate, and the traction acts in the middle between both
        now = [np.where(is_open, 0.5 * free, v) for free, v in zip(trial.free_velocity, now, strict=True)]
    mean = [np.where(is_stuck, 0.0, v - shift) for v, shift in zip(sums, trial.shift, strict=True)]
    now = [np.where(is_stuck, 0.0 if at_end else 0.5 * v, each) for v, each in zip(before, now, strict=True)]
    relieved = [t - z * v for t, z, v in zip(shear, trial.impedance, mean, strict=True)]
    return Sliding(mean, now, [np.where(is_open, 0.0, t) for t in relieved])


def slip_after(slip: Vector, rates: Vector, since: Array) -> Vector:
    """Return the slip at the traction [m]: V of the step that ends with it times the time since the one before."""
    return [s + since * v for s, v in zip(slip, rates, strict=True)]


def opening_after(
    normal_stress: Array, trial: Array, compliance: Array, normal_stress_before: Array, gap: Array, at_end: bool
) -> Any:
    """Return the opening at the traction [m].

    Parameters
    ----------
    normal_stress, trial : admissible and trial normal stress [Pa].
    compliance : opening per normal stress beyond the trial one [m/Pa].
    normal_stress_before : at the previous traction [Pa].
    gap : distance of the two sides [m], negative where they overlap.
    """
    excess: Any = normal_stress - trial
    if at_end:
        return excess * compliance
    # The traction follows the displacement by half a step: where there was pressure the sides still touch.
    return np.where((normal_stress_before > 0) | (gap < 0), 0.0, gap)


def total(terms: Iterable[Any]) -> Any:
    """Return the sum of terms, one per tangent."""
    return reduce(add, terms)


def dot(first: Vector, second: Vector) -> Any:
    """Return the scalar product of two vectors."""
    return total(x * y for x, y in zip(first, second, strict=True))


def length(vector: Vector) -> Any:
    """Return the length of a vector; its derivative is zero where the length is."""
    if len(vector) == 1:
        return np.abs(vector[0])
    square = dot(vector, vector)
    # Compared with zero, so that a length that is not a number remains one.
    return np.where(np.equal(square, 0.0), 0.0, np.sqrt(square))


def unit(vector: Vector, size: Array) -> Vector:
    """Return a vector of known length over this length; zero where it has none."""
    if len(vector) == 1:
        return [np.sign(vector[0])]
    return [np.where(size > 0, each / size, 0.0) for each in vector]
