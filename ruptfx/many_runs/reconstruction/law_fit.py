"""The friction law of a case fitted to reconstructed tractions, slip rates and normal stresses, with intervals.

Where the interface slides, shear traction minus strength of the law is zero. Posterior samples of the slip rate give
the distribution of this residual r for every set of parameters p: its density at zero is their likelihood,

    -2 log L(p, s) = m' C^-1 m + log det C,        C = cov r(p) + s^2 G G',        m = mean of r(p),

so that correlated errors of slip and traction count as they are, and slip that is uncertain does not flatten the curve
(errors in variables). r has one row for each position and window of time. G adds an error of each position that is
constant in time: slip that is rougher than the prior changes the static traction by far more than its deviation; its
size s is a further unknown. Logarithms of parameters have normal priors about the values of the case. The inverse of a
covariance from a number of samples is corrected (Hartlap et al. 2007).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ruptfx import Table
from ruptfx.case import Case, parse_case
from ruptfx.input.quantities import with_prefix
from ruptfx.input.schema import CaseError, Part, dotted_keys, set_key, unit_of_key, value_at
from ruptfx.laws.friction import FrictionLaw

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
FACTOR = 1.0
"""Prior standard deviation of the logarithm of a parameter, where the case has no `sigma` of it."""
RESOLVED = 0.5
"""Part of the prior standard deviation below which a parameter is resolved."""
OFFSET, OFFSET_FACTOR = 0.02, 1.5
"""Prior median of the error of friction of a position, and standard deviation of its logarithm."""
FOOT, ONSET, SURE = 0.1, 0.5, 3.0
"""Parts of the largest slip rate at which slip, and the comparison, begin; deviations above zero at which it ends."""
POSITIONS, SAMPLES, ROWS, STARTS = 12, 240, 72, 100
"""Largest number of positions, number of samples, largest number of rows, and number of starts of the search."""


@dataclass(frozen=True)
class Histories:
    """Samples of an interface at some points; the mean first.

    Attributes
    ----------
    points : ndarray of int, shape (p,)
    times : ndarray, shape (knots,)
        [s]
    slip_rate, shear_traction, normal_stress : ndarray, shape (1 + samples, knots, p)
        In the direction of slip [m/s], [Pa], [Pa].
    deviation : ndarray, shape (knots, p)
        Standard deviation of the slip rate [m/s].
    initial : (ndarray, ndarray), shapes (p,)
        Initial normal stress and magnitude of the shear stress [Pa].
    position : ndarray, shape (p,), of a surface (p, 2)
        [m]
    """

    points: Integers
    times: Floats
    slip_rate: Floats
    shear_traction: Floats
    normal_stress: Floats
    deviation: Floats
    initial: tuple[Floats, Floats]
    position: Floats


@dataclass(frozen=True)
class LawFit:
    """Parameters of a friction law.

    Attributes
    ----------
    kind : str
    values, deviations : dict of str to float
        By key; standard deviations of the logarithms.
    units : dict of str to str
    unresolved : list of str
        Keys whose interval is that of the prior.
    misfit : float
        Mean square of the residuals over their variance.
    offset : float
        Standard deviation of the friction between positions beyond that of the samples.
    rows : int
        Number of residuals.
    points : ndarray of int
        Points of the interface.
    friction : ndarray, shape (knots, p)
        Strength of the law over the normal stress for the mean slip rate while it slides, else not a number.
    case : Case or None
        With these parameters; None if they are no valid law.
    note : str
        Why there is no case.
    """

    kind: str
    values: dict[str, float]
    deviations: dict[str, float]
    units: dict[str, str]
    unresolved: list[str]
    misfit: float
    offset: float
    rows: int
    points: Integers
    friction: Floats
    case: Case | None = field(default=None, repr=False)
    note: str = ""

    def interval(self, key: str) -> tuple[float, float]:
        """Return the ends of the interval of 68 %."""
        factor = float(np.exp(self.deviations[key]))
        return self.values[key] / factor, self.values[key] * factor

    def table(self) -> Table:
        """Return the entry of the summary."""
        parameters = {
            key: {"value": value, "interval": list(self.interval(key)), "unit": self.units[key],
                  "resolved": key not in self.unresolved}
            for key, value in self.values.items()
        }  # fmt: skip
        return {"kind": self.kind, "misfit": self.misfit, "offset": self.offset, "residuals": self.rows,
                "parameters": parameters, "note": self.note}  # fmt: skip

    def sentence(self) -> str:
        """Return the law with its intervals."""

        def shown(value: float, unit: str) -> str:
            return f"{value:.3g}" if unit == "1" else with_prefix(value, unit)

        parts = []
        for key, value in self.values.items():
            first, last = (shown(each, self.units[key]) for each in self.interval(key))
            unsure = ", not resolved" if key in self.unresolved else ""
            parts.append(f"{key.rpartition('.')[2]} = {shown(value, self.units[key])} ({first} to {last}{unsure})")
        return (
            f"{self.kind} fits with {', '.join(parts)} at {self.misfit:.2g} times the deviation squared, "
            f"and {self.offset:.2g} between positions"
        )


def free_parameters(case: Case, name: str) -> dict[str, tuple[float, float, float]]:
    """Return starts, prior means and prior standard deviations of logarithms, by key below the law of an interface.

    They are those that `[[unknowns]]` names, or all positive numbers of the law.
    """
    prefix, law = f"faults.{name}.friction.", case.faults[name].friction
    named = {each.key.removeprefix(prefix): each for each in case.unknowns
             if each.key.startswith(prefix) and each.shape == "number"}  # fmt: skip
    result = {}
    for key in named or dotted_keys(law):
        value = value_at(law, key)
        if not isinstance(value, float) or not value > 0:
            continue
        sigma = FACTOR
        if key in named and named[key].sigma is not None:
            sigma = float(named[key].sigma or 1.0) / (1.0 if named[key].scale == "log" else value)
        result[key] = (value, float(np.log(value)), sigma)
    return result


def _changed(part: Part, key: str, value: float) -> Part:
    """Return a part with an unchecked value of a dotted key."""
    name, _, below = key.partition(".")
    return part.substituted({name: _changed(getattr(part, name), below, value) if below else value})


def strength(law: FrictionLaw, made: Histories, begin: Integers) -> Floats:
    """Return the strength of a law along the histories, shape (1 + samples, knots, p); before `begin` nothing slips."""
    rate = np.where(np.arange(len(made.times))[:, None] >= begin, np.maximum(made.slip_rate, 0.0), 0.0)
    sigma = np.maximum(made.normal_stress, 0.0)
    normal, shear = (np.broadcast_to(each, rate[:, 0].shape).copy() for each in made.initial)
    state = law.initial_state(normal, shear, np.zeros_like(normal))
    last, at, result = np.zeros_like(normal), 0.0, np.empty_like(rate)
    for knot, time in enumerate(made.times):
        now, pressed = rate[:, knot], sigma[:, knot]
        # The slip rate is linear between knots: states that depend on the slip are exact.
        state = law.advance(state, 0.5 * (last + now), pressed, time - at)
        result[:, knot] = law.strength(now, pressed, state)
        last, at = now, time
    return result


def _windows(made: Histories, width: int) -> tuple[Integers, list[tuple[int, slice]]]:
    """Return the knot at which each point begins to slip, and the point and knots of every row."""
    speed, points = made.slip_rate[0], np.arange(len(made.points))
    top = np.argmax(speed, axis=0)
    before = np.arange(len(speed))[:, None] < top

    def last_below(part: float) -> Integers:
        slow = (speed < part * speed[top, points]) & before
        return np.where(slow.any(axis=0), len(speed) - np.argmax(slow[::-1], axis=0), 0)

    begin, onset, rows = last_below(FOOT), last_below(ONSET), list[tuple[int, slice]]()
    for point in points:
        sure = speed[onset[point] :, point] > SURE * made.deviation[onset[point] :, point]
        end = onset[point] + (len(sure) if sure.all() else int(np.argmin(sure)))
        rows += [(int(point), slice(first, min(first + width, end))) for first in range(onset[point], end, width)]
    return begin, rows


class _Likelihood:
    """Minus twice the logarithm of the posterior density of parameters."""

    def __init__(self, law: FrictionLaw, made: Histories, width: int) -> None:
        self.made, self.law = made, law
        self.begin, rows = _windows(made, width)
        while len(rows) > ROWS:
            width *= 2
            self.begin, rows = _windows(made, width)
        self.rows = rows
        self.alike = np.equal.outer(*2 * (np.array([point for point, _ in rows]),)).astype(float)

    def at(self, values: Mapping[str, float]) -> FrictionLaw:
        """Return the law with other parameters at the points."""
        part: Part = self.law
        for key, value in values.items():
            part = _changed(part, key, value)
        return part.at(self.made.position)  # type: ignore[return-value]

    def residuals(self, values: Mapping[str, float]) -> Floats:
        """Return traction minus strength over the initial normal stress, shape (1 + samples, rows)."""
        off = (self.made.shear_traction - strength(self.at(values), self.made, self.begin)) / self.made.initial[0]
        return np.array([off[:, knots, point].mean(axis=1) for point, knots in self.rows]).T

    def parts(self, values: Mapping[str, float], offset: float) -> tuple[float, float]:
        """Return the squared residuals over their covariance, and the logarithm of its determinant.

        Parameters
        ----------
        values : dict of str to float
        offset : float
            Standard deviation of the error of friction of a position.
        """
        samples = self.residuals(values)[1:]
        mean, (count, rows) = samples.mean(axis=0), samples.shape
        covariance = np.atleast_2d(np.cov(samples.T))
        covariance += offset**2 * self.alike
        covariance[np.diag_indices(rows)] += 1e-6 * np.trace(covariance) / rows
        sign, size = np.linalg.slogdet(covariance)
        if not (np.isfinite(size) and sign > 0):
            return np.inf, np.inf
        return float(mean @ np.linalg.solve(covariance, mean)) * (count - rows - 2) / (count - 1), float(size)


def fit_law(case: Case, name: str, made: Histories, width: int) -> LawFit | None:
    """Return the law of an interface with parameters that fit the histories; None where nothing slides surely.

    Parameters
    ----------
    case : Case
    name : str
        Of the interface.
    made : Histories
    width : int
        Knots of a row.
    """
    from scipy.optimize import minimize

    law = case.faults[name].friction
    if law is None:
        return None
    free, likelihood = free_parameters(case, name), _Likelihood(law, made, width)
    if not free or len(likelihood.rows) <= len(free):
        return None
    keys, table = list(free), np.array([*free.values(), (OFFSET, np.log(OFFSET), OFFSET_FACTOR)])
    starts, middles, sigmas = table.T

    def cost(logarithms: Floats) -> float:
        with np.errstate(all="ignore"):
            squares, size = likelihood.parts(
                dict(zip(keys, np.exp(logarithms[:-1]), strict=True)), float(np.exp(logarithms[-1]))
            )
        total = squares + size + float(np.sum(((logarithms - middles) / sigmas) ** 2))
        return total if np.isfinite(total) else 1e12

    # The density has several maxima: a search from the case alone may end in the wrong one.
    random = np.random.default_rng(0).normal(size=(STARTS, len(starts)))
    best = min([np.log(starts), *(middles + sigmas * random)], key=cost)
    for _ in range(2):  # the second simplex leaves a valley in which the first one has collapsed
        simplex = np.vstack([best, best + 0.3 * np.diag(sigmas.clip(max=1.0))])
        best = minimize(cost, best, method="Nelder-Mead", options={
            "initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-2, "maxfev": 80 * len(starts),
        }).x  # fmt: skip
    values, offset = dict(zip(keys, np.exp(best[:-1]).tolist(), strict=True)), float(np.exp(best[-1]))
    misfit = likelihood.parts(values, offset)[0] / len(likelihood.rows)
    # Bands of a prior that is wrong, and meshes, leave residuals above their deviation: intervals grow with them.
    covariance = np.linalg.inv(0.5 * _curvature(cost, best, sigmas)) * max(misfit, 1.0)
    deviations = np.minimum(np.sqrt(np.diag(covariance)), sigmas)[:-1]
    shown = np.full(made.slip_rate[0].shape, np.nan)
    ratio = strength(likelihood.at(values), made, likelihood.begin)[0] / np.maximum(made.normal_stress[0], 1e-300)
    for point, knots in likelihood.rows:
        shown[knots, point] = ratio[knots, point]
    fitted, note = _fitted(case, name, values)
    return LawFit(
        law.kind(), values, dict(zip(keys, deviations.tolist(), strict=True)),
        {key: unit_of_key(case, f"faults.{name}.friction.{key}") for key in keys},
        [key for key, size, sigma in zip(keys, deviations, sigmas[:-1], strict=True) if size > RESOLVED * sigma],
        misfit, offset, len(likelihood.rows), made.points, shown, fitted, note,
    )  # fmt: skip


def _curvature(cost: object, best: Floats, sigmas: Floats, step: float = 0.03) -> Floats:
    """Return the second derivatives by differences, with eigenvalues not below those of the prior."""
    assert callable(cost)
    count, size = len(best), step * np.diag(np.minimum(sigmas, 1.0))
    result = np.zeros((count, count))
    for i in range(count):
        for j in range(i + 1):
            signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
            total = sum(a * b * cost(best + a * size[i] + b * size[j]) for a, b in signs)
            result[i, j] = result[j, i] = total / (4 * size[i, i] * size[j, j])
    scaled, vectors = np.linalg.eigh(result * np.outer(sigmas, sigmas))
    return np.asarray((vectors * np.maximum(scaled, 2.0)) @ vectors.T / np.outer(sigmas, sigmas))


def _fitted(case: Case, name: str, values: Mapping[str, float]) -> tuple[Case | None, str]:
    """Return the case with other parameters of its law, or why they are refused."""
    table = case.table()
    for key, value in values.items():
        set_key(table, f"faults.{name}.friction.{key}", float(f"{value:.6g}"))
    try:
        result = parse_case(table)
    except CaseError as error:
        return None, str(error)
    return (result, "") if isinstance(result, Case) else (None, "no case with bodies")
