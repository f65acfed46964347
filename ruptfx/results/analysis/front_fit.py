"""Fit of a mode II front to strain gauges near the interface: fracture energy, stress intensity, speed and passage.

While a front passes, gauges at heights of some millimetres see the field of `near_tip` at x - v (t - t_0). Speed v,
passage t_0 and the length of the process zone are found by least squares, with numbers that enter linearly: K_II and
its rate (`mode_II_rate`: near c_R the field of a K_II that grows with the way is another one than that of a constant
K_II, by 9 % of the fracture energy at 0.95 c_R and 80 mm), the field that grows with sqrt(r), the stress along the
interface, which follows from no traction, and the residual shear stress. Samples count while the tip is within 2.5 a_s
heights of the gauge, a_s = sqrt(1 - v^2 / c_s^2), where the singular field is large: fields contract with a_s.
Gauges at several positions along the interface determine the speed best; near c_R an error of 1 % in it is 10 % in the
fracture energy. Gauges at several heights determine the process zone.
Source: Svetlizky and Fineberg (2014), who found the fracture energy of such traces; sqrt(r) after Freund (1990).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ruptfx import RuptfxError
from ruptfx.laws.fracture import A_II, slowness_factors
from ruptfx.results.analysis.near_tip import Medium, mode_II, mode_II_rate

Array = np.ndarray

COMPONENTS = ("xx", "yy", "xy")
SPEEDS = np.array([0.03, 0.06, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.86, 0.92, 0.96, 0.98])  # c_R, where to begin
SLOWEST, FASTEST = 0.01, 0.995  # c_R
STARTS, WINDOWS = 3, 3
MOST = 1000  # samples in the search for starting values
REACH = 2.5  # a_s heights of the gauge, on either side of the tip
SHORTEST, LONGEST = 0.02, 2.0  # gauge heights: limits of a process zone that can be identified
EXPLAINED = 0.9  # smallest explained part of the variance of the samples
DOUBT = 0.3  # largest standard error over the fracture energy
LARGEST = 0.1  # strain; larger values are in another unit than m/m
FEWEST = 12  # samples of a component of a gauge within reach


@dataclass(frozen=True)
class Trace:
    """Strains at one point against time.

    Attributes
    ----------
    x, y : float
        Position along the interface and height above it [m].
    time : ndarray, shape (times,)
        Increasing [s].
    strain : mapping of ndarray, shape (times,)
        Changes of strain since before the rupture [m/m], by component: some of ``xx``, ``yy``, ``xy`` (of the tensor).
        Arrays of xarray, of times too, need the `units` "1" and "s".
    """

    x: float
    y: float
    time: Array
    strain: Mapping[str, Array]


@dataclass(frozen=True)
class FrontFit:
    """Front fitted to the traces, with standard errors.

    Errors are the larger of two estimates: residuals independent from sample to sample, and residuals
    independent from trace to trace only, as for an incomplete model of the field (Source: Liang and Zeger 1986,
    Biometrika 73, 13). Neither includes errors common to all traces, such as wrong elastic constants.

    Attributes
    ----------
    fracture_energy, fracture_energy_error : float
        G = A_II K_II^2 / E' [J/m2].
    K_II, K_II_error : float
        With the sign of the shear stress ahead of the tip [Pa sqrt(m)].
    speed, speed_error : float
        [m/s]
    position, passage, passage_error : float
        Mean position of the gauges [m], and time of the tip at it with its error [s].
    process_zone : float
        Length of the zone behind the tip over which the shear stress falls as in `near_tip.mode_II` [m]; gauges higher
        than its length do not determine it.
    explained : float
        Explained part of the variance of the samples.
    residual : float
        Root mean square residual [1].
    samples : int
    """

    fracture_energy: float
    fracture_energy_error: float
    K_II: float
    K_II_error: float
    speed: float
    speed_error: float
    position: float
    passage: float
    passage_error: float
    process_zone: float
    explained: float
    residual: float
    samples: int

    def tip(self, time: Array) -> Array:
        """Return the position of the tip [m]."""
        return self.position + self.speed * (time - self.passage)


@dataclass(frozen=True)
class _Samples:
    """All samples in one column: position, time, component, value, and gauge."""

    x: Array
    y: Array
    time: Array
    component: Array
    value: Array
    gauge: Array

    def part(self, chosen: Array | slice) -> _Samples:
        return _Samples(*(getattr(self, name)[chosen] for name in ("x", "y", "time", "component", "value", "gauge")))

    def spread(self) -> float:
        """Return the sum of squares about the mean of each component."""
        parts = (self.value[self.component == number] for number in range(len(COMPONENTS)))
        return sum(float(np.sum((part - part.mean()) ** 2)) for part in parts if len(part))

    def columns(self, numbers: Array, medium: Medium) -> Array:
        """Return strains per unit coefficient, shape (samples, 4 or 5), for given speed, passage and zone.

        Coefficients are K_II, its rate, that of sqrt(r), and the uniform stresses along x and in shear as far as the
        components have them.
        """
        speed, passage, zone = (float(value) for value in numbers)
        late = self.time - passage
        ahead = self.x - speed * late
        fields = np.array(
            [
                np.choose(self.component, [field.xx, field.yy, field.xy])
                for field in (
                    mode_II(ahead, self.y, speed, medium, 1.0, -0.5, zone),
                    mode_II_rate(ahead, self.y, late, speed, medium, 1.0, zone),
                    mode_II(ahead, self.y, speed, medium, 1.0, 0.5, zone),
                )
            ]
        )
        along = 1 / medium.modulus
        ratio = 1 - 2 * (medium.c_s / medium.c_p) ** 2  # -e_yy / e_xx of a stress along x alone
        columns = [*fields, np.choose(self.component, [along, -ratio * along, 0.0])]
        columns.append(np.where(self.component == 2, 0.5 / medium.shear_modulus, 0.0))
        return np.stack([column for column in columns if column.any()], axis=1)


def fit_front(traces: Sequence[Trace], medium: Medium, direction: int = 1, reach: float = REACH) -> FrontFit:
    """Fit one front of constant speed to the traces of one or more gauges.

    Parameters
    ----------
    traces : sequence of Trace
        Gauges so near each other that the front does not change between them.
    direction : int
        1 where the front runs towards positive x, -1 towards negative x.
    reach : float
        Samples count while the tip is within that many a_s heights of the gauge.

    Raises
    ------
    RuptfxError
        If traces are invalid, or no sub-Rayleigh front explains them; the message states the reason.
    """
    samples, position = _gathered(traces, direction)
    few = samples.part(slice(None, None, max(1, len(samples.value) // MOST)))
    tried, too_few = [], None
    for speed, passage in _starts(few, medium, reach):
        try:
            tried.append(_solve(few, speed, passage, 0.0, medium, reach))
        except RuptfxError as error:  # diverged; another start may converge
            too_few = error
    if not tried and too_few is not None:
        raise too_few
    good = [each for each in tried if each.explained >= EXPLAINED]
    # A slow front is so long in the window that it may be fitted to anything weak; the strongest strains are the front.
    best = max(good or tried, key=lambda each: each.gained if good else each.explained, default=None)
    if best is None:
        raise RuptfxError("front_fit: no front explains anything of the traces; was there one in this time, in s?")
    speed, passage, zone = (float(value) for value in best.values[:3])
    return _judged(_solve(samples, speed, passage, zone, medium, reach), samples, medium, position)


def _gathered(traces: Sequence[Trace], direction: int) -> tuple[_Samples, float]:
    """Return all samples, with x from the mean position along the direction of the front, and that position."""
    if direction not in (1, -1):
        raise RuptfxError(f"front_fit: direction = {direction}: must be 1 or -1")
    if not traces:
        raise RuptfxError("front_fit: no trace was given; give one Trace per gauge")
    position = float(np.mean([trace.x for trace in traces]))
    columns: list[list[Array]] = [[], [], [], [], [], []]
    for number, trace in enumerate(traces, 1):
        name = f"front_fit: trace {number}"
        time = _in_units(trace.time, "s", f"{name}: time")
        if trace.y <= 0:
            raise RuptfxError(f"{name}: y = {trace.y:g} m: the gauge must be above the interface, where y > 0")
        if len(time) < FEWEST or not np.all(np.diff(time) > 0):
            raise RuptfxError(f"{name}: {len(time)} times: at least {FEWEST} that increase are needed")
        if not trace.strain:
            raise RuptfxError(f"{name}: no strain; give some of {', '.join(COMPONENTS)}")
        for component, values in trace.strain.items():
            if component not in COMPONENTS:
                raise RuptfxError(f"{name}: strain '{component}': must be one of {', '.join(COMPONENTS)}")
            if np.shape(values) != time.shape or not np.isfinite(values).all():
                raise RuptfxError(f"{name}: strain '{component}': {len(time)} finite numbers are needed, one per time")
            strain = _in_units(values, "1", f"{name}: strain '{component}'")
            if np.abs(strain).max() > LARGEST:
                raise RuptfxError(
                    f"{name}: strain '{component}' is up to {np.abs(strain).max():.3g}: more than {LARGEST:g} m/m is "
                    "not elastic; is it in microstrain or per cent?"
                )
            sign = direction if component == "xy" else 1  # reflection reverses the sign of shear
            full = np.full(len(time), 1.0)
            columns[0].append(direction * (trace.x - position) * full)
            columns[1].append(trace.y * full)
            columns[2].append(time)
            columns[3].append(np.full(len(time), COMPONENTS.index(component)))
            columns[4].append(sign * strain)
            columns[5].append(number * full)
    x, y, when, which, value, gauge = (np.concatenate(column) for column in columns)
    if np.ptp(value) == 0:
        raise RuptfxError("front_fit: the traces are constant: no front passed; take a window in which it does")
    return _Samples(x, y, when, which.astype(np.int64), value, gauge), position


def _in_units(values: Array, unit: str, name: str) -> Array:
    """Return plain numbers; arrays with a unit attribute, as those of xarray, must have the right one."""
    attributes = getattr(values, "attrs", None)
    if attributes is not None and attributes.get("units") != unit:
        text = f"units = '{attributes['units']}'" if "units" in attributes else "no units"
        raise RuptfxError(f"{name} has {text}: must be '{unit}'; convert it, and set .attrs['units'] = '{unit}'")
    return np.asarray(values, dtype=float)


def _starts(samples: _Samples, medium: Medium, reach: float) -> list[tuple[float, float]]:
    """Return the best passage for every speed, sorted by the strain variance they explain."""
    first, last, height = samples.time.min(), samples.time.max(), samples.y.min()
    items = []
    for speed in SPEEDS * medium.c_R:
        width = 0.5 * slowness_factors(speed, medium.c_p, medium.c_s)[1] * height / speed  # of the strains, in time
        for passage in np.linspace(first, last, max(8, int((last - first) / width)) + 2)[1:-1]:
            near = _near(samples, speed, passage, medium, reach)
            if len(near.value) >= FEWEST:
                solution = _linear(near, speed, passage, 0.0, medium)
                items.append((solution.gained * max(solution.explained, 0.0), float(speed), float(passage)))
    best = {speed: (gained, passage) for gained, speed, passage in sorted(items)}  # the last of every speed
    ranked = sorted(((gained, speed, passage) for speed, (gained, passage) in best.items()), reverse=True)
    return [(speed, passage) for _, speed, passage in ranked[:STARTS]]


def _near(samples: _Samples, speed: float, passage: float, medium: Medium, reach: float) -> _Samples:
    height = reach * slowness_factors(speed, medium.c_p, medium.c_s)[1] * samples.y
    return samples.part(np.abs(samples.x - speed * (samples.time - passage)) <= height)


@dataclass(frozen=True)
class _Solution:
    """Speed, passage, process zone, K_II and the other coefficients, with residuals near the tip."""

    values: Array
    residual: Array
    near: _Samples

    @property
    def explained(self) -> float:
        """Explained part of the variance."""
        spread = self.near.spread()
        return 1 - float(self.residual @ self.residual) / spread if spread > 0 else 0.0

    @property
    def gained(self) -> float:
        """Explained variance."""
        return self.explained * self.near.spread() / len(self.residual)


def _linear(near: _Samples, speed: float, passage: float, zone: float, medium: Medium) -> _Solution:
    """Return the least-squares coefficients at a given speed, passage and process zone."""
    columns = near.columns(np.array([speed, passage, zone]), medium)
    scale = np.abs(columns).max(axis=0)
    coefficients = np.linalg.lstsq(columns / scale, near.value, rcond=None)[0] / scale
    return _Solution(np.array([speed, passage, zone, *coefficients]), near.value - columns @ coefficients, near)


def _solve(samples: _Samples, speed: float, passage: float, zone: float, medium: Medium, reach: float) -> _Solution:
    """Solve the least-squares problem in all parameters, in a window that follows the tip."""
    bounds = np.array([SLOWEST, -np.inf, 0.0]), np.array([FASTEST, np.inf, LONGEST])
    near = _near(samples, speed, passage, medium, reach)
    for _ in range(WINDOWS):
        if len(near.value) < FEWEST:
            raise RuptfxError(
                f"front_fit: {len(near.value)} samples lie near the tip, {FEWEST} are the least; sample faster"
            )
        scale = np.array([medium.c_R, near.y.mean() / speed, near.y.min()])

        def residual(values: Array, near: _Samples = near, scale: Array = scale) -> Array:
            left: Array = _linear(near, *_from_middle(values * scale), medium).residual / np.abs(near.value).max()
            return left

        begin = np.array([speed, passage + 0.5 * zone / speed, zone]) / scale
        begin = np.clip(begin, [1.001 * SLOWEST, -np.inf, 0.01], [0.999 * FASTEST, np.inf, 0.99 * LONGEST])
        result = least_squares(residual, begin, bounds=bounds, xtol=1e-6, ftol=1e-6)
        if not result.success:
            raise RuptfxError(
                f"front_fit: the least-squares fit has not converged in {result.nfev} evaluations; give traces with "
                "less noise, or more of them"
            )
        speed, passage, zone = _from_middle(result.x * scale)
        last, near = near, _near(samples, speed, passage, medium, reach)
    return _linear(last, speed, passage, zone, medium)


def _from_middle(values: Array) -> tuple[float, float, float]:
    """Convert speed, passage of the middle of the zone, and zone to speed, passage of the tip, and zone."""
    speed, middle, zone = (float(value) for value in values)
    return speed, middle - 0.5 * zone / speed, zone


def _jacobian(solution: _Solution, medium: Medium) -> Array:
    """Return the derivative of the strains with respect to all parameters, shape (samples, parameters)."""
    near, numbers, coefficients = solution.near, solution.values[:3], solution.values[3:]
    slopes = []
    for index, step in enumerate((1e-5 * numbers[0], 1e-5 * near.y.mean() / numbers[0], 1e-4 * near.y.min())):
        change = np.zeros(3)
        change[index] = step
        low = np.maximum(numbers - change, 0.0)  # a zone has no negative length
        low[1] = numbers[1] - change[1]
        upper, lower = (near.columns(values, medium) @ coefficients for values in (numbers + change, low))
        slopes.append((upper - lower) / (numbers + change - low)[index])
    return np.column_stack([*slopes, near.columns(numbers, medium)])


def _covariances(solution: _Solution, medium: Medium) -> tuple[Array, Array]:
    """Return covariances of all parameters, for residuals independent by sample, and by trace only."""
    jacobian, residual, near = _jacobian(solution, medium), solution.residual, solution.near
    if solution.values[2] < SHORTEST * near.y.min():
        jacobian[:, 2] = 0.0  # the zone was fixed; its effect equals a shift of the passage
    # Speed, passage and coefficients differ by many orders: scaled, so that the inverse keeps its digits.
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    jacobian = jacobian / scale
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    independent = inverse * float(residual @ residual) / max(len(residual) - len(solution.values), 1)
    trace = len(COMPONENTS) * near.gauge + near.component
    numbers = np.unique(trace)
    sums = np.array([residual[trace == number] @ jacobian[trace == number] for number in numbers])
    by_trace = inverse @ (sums.T @ sums) @ inverse * len(numbers) / max(len(numbers) - 1, 1)
    return independent / np.outer(scale, scale), by_trace / np.outer(scale, scale)


def _judged(solution: _Solution, samples: _Samples, medium: Medium, position: float) -> FrontFit:
    """Return the result with its errors; raise an error that states why a fit is not acceptable."""
    residual = solution.residual
    speed, passage, zone, K = (float(value) for value in solution.values[:4])
    first, last = samples.time.min(), samples.time.max()
    if not first < passage < last:
        raise RuptfxError(
            f"front_fit: the tip would pass at {passage:.6g} s, the traces have {first:.6g} to {last:.6g} s: no front "
            "passed the gauges in this time; take a window in which it does"
        )
    if not 1.01 * SLOWEST < speed / medium.c_R < 0.999 * FASTEST:
        raise RuptfxError(
            f"front_fit: speed = {speed:.6g} m/s is a bound of the search, {SLOWEST:g} to {FASTEST:g} c_R: the front "
            "is slower or faster, and near_tip.mode_II does not describe it"
        )
    explained = solution.explained
    if not explained >= EXPLAINED:
        raise RuptfxError(
            f"front_fit: a front explains {explained:.0%} of the strains, {EXPLAINED:.0%} is the least: too much "
            "noise, several fronts at once, or none below c_R; take a window with one front"
        )
    independent, by_trace = _covariances(solution, medium)
    energy = A_II(speed, medium.c_p, medium.c_s) * K**2 / medium.modulus
    h = 1e-5 * speed
    slope = (A_II(speed + h, medium.c_p, medium.c_s) - A_II(speed - h, medium.c_p, medium.c_s)) / (2 * h)
    gradient = np.zeros(len(solution.values))
    gradient[[0, 3]] = slope * K**2 / medium.modulus, 2 * energy / K
    errors = np.sqrt(np.maximum(np.maximum(np.diag(independent), np.diag(by_trace)), 0.0))
    energy_error = float(np.sqrt(max(gradient @ each @ gradient for each in (independent, by_trace))))
    if not energy_error <= DOUBT * energy:
        raise RuptfxError(
            f"front_fit: fracture energy {energy:.4g} +- {energy_error:.4g} J/m2: the traces do not tell it; give "
            "more components, or gauges nearer to the interface"
        )
    return FrontFit(
        fracture_energy=energy, fracture_energy_error=energy_error, K_II=K, K_II_error=float(errors[3]), speed=speed,
        speed_error=float(errors[0]), position=position, passage=passage, passage_error=float(errors[1]),
        process_zone=zone, explained=explained, residual=float(np.sqrt(np.mean(residual**2))), samples=len(residual),
    )  # fmt: skip
