"""Distance of a run from a sliding mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ruptfx.input.schema import CaseError
from ruptfx.input.units import Coordinate, Duration, Length, Positive, Speed
from ruptfx.readings.misfits import Floats, Misfit, Request, Sample, Trace

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings

ROUND = 0.01  # rounding of absolute differences between neighbouring points
EARLY, MIDDLE, LATE, SOFT = 0.2, 0.59, 0.98, 0.02  # windows of the way of the tip, and the width of their edges
MOST_POINTS = 5000


class ModeDegree(Misfit):
    """One minus the degree of a sliding mode, smooth in the slip rate.

    The degrees are those of `ruptfx.results.analysis.modes`, in which steps are replaced: a point slides to the degree
    H = u^n / (1 + u^n), u = |V| / threshold, n = `steepness`; the sliding fraction f is the sum of H over that of its
    largest values until then, which is the way of the tip; the number of zones r is half the sum of |H - H of the next
    point|; saved times count by smooth windows of the way. Slip rates are those along the first tangent. The
    derivative by r exists, so that a search sees a second zone before it is one.
    """

    example: ClassVar[str] = (
        '{ kind = "mode_degree", mode = "crack", threshold = 0.1, loaded_end = 1e-3, far_end = 11e-3, spacing = 1e-3, '
        "interval = 2e-7, steepness = 1.0 }"
    )

    fault: str = "main"
    """Name of the interface."""
    mode: Literal["crack", "pulse", "train", "pulses_into_crack"]
    """Sliding mode."""
    threshold: Speed
    """Slip rate at which a point slides to the degree one half."""
    loaded_end: Coordinate
    """Position from which the rupture runs."""
    far_end: Coordinate
    """Position to which it runs."""
    spacing: Length
    """Distance of the positions at which the slip rate is read; give that of the nodes."""
    interval: Duration
    """Time between readings."""
    least_points: Positive | None = None
    """Positions in a zone: the degree of a run with zones of fewer positions is smaller in proportion. Default: no
    such factor."""
    steepness: Annotated[float, Field(ge=1)] = 4.0
    """Exponent n of the smooth step. With 1 points that slide much faster than the threshold still have a derivative,
    which leads out of a crack; with 4 degrees are close to those of the analysis."""
    weight: Annotated[float, Field(gt=0)] = 1.0
    """Factor of the term."""

    @model_validator(mode="after")
    def _complete(self) -> ModeDegree:
        way = abs(self.far_end - self.loaded_end)
        if way < 5 * self.spacing:
            raise ValueError(
                f"spacing = {self.spacing:g} m: fewer than 6 positions between loaded_end and far_end; make it smaller"
            )
        if way > MOST_POINTS * self.spacing:
            raise ValueError(f"spacing = {self.spacing:g} m: more than {MOST_POINTS} positions; make it larger")
        return self

    @property
    def _positions(self) -> Floats:
        way = self.far_end - self.loaded_end
        count = 1 + int(abs(way) / self.spacing * (1 + 1e-9))
        return self.loaded_end + np.sign(way) * self.spacing * np.arange(count)

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        duration = bodies.model.case.duration
        if self.interval > duration / 4:
            raise CaseError(
                f"{key}.interval = {self.interval:g} s: at most a quarter of duration = {duration:g} s; shorten it"
            )
        times = np.arange(0.0, duration * (1 - 1e-9), self.interval)
        for end in ("loaded_end", "far_end"):  # what is between them is then on the interface
            bodies.at_fault(self.fault, getattr(self, end), key, end)
        items: list[Request] = []
        for position in self._positions:
            channels = bodies.at_fault(self.fault, float(position), key)
            rate = next(channel for channel in channels if channel.name.startswith("slip_rate"))
            items.append(Trace(replace(rate, name=f"slip rate at {position:g} m"), times))
        return items

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        rates = np.array([sample.values for sample in samples]).T
        degree, slope = degree_of(rates, self.mode, self.threshold, self.least_points, self.steepness)
        return self.weight * (1 - degree), list(-self.weight * slope.T)


def degree_of(
    rates: Floats, mode: str, threshold: float, least_points: float | None = None, steepness: float = 4.0
) -> tuple[float, Floats]:
    """Return the degree of a mode and its derivative by the slip rates.

    Parameters
    ----------
    rates : ndarray, shape (times, points)
        Slip rates [m/s] at positions of equal distance from the loaded end on.
    mode : str
        crack, pulse, train or pulses_into_crack.
    threshold : float
        [m/s]
    least_points : float, optional
        Number of positions in a zone below which the degree is smaller in proportion.
    steepness : float
        Exponent of the smooth step over slip rate.
    """
    slides = _Slides(rates, threshold, steepness)
    f, r, reach = slides.fraction, slides.zones, slides.way[-1]
    late, late_slope = _mean(slides, _DEGREES["crack" if mode == "pulses_into_crack" else mode](f, r), MIDDLE, LATE)
    degree, by_late, early_slope = late, 1.0, None
    if mode == "pulses_into_crack":
        early, early_slope = _mean(slides, _several(f, r), EARLY, MIDDLE)
        degree = float(np.sqrt(late * early))
        by_late, by_early = (0.5 * degree / each if each > 0 else 0.0 for each in (late, early))
        early_slope = early_slope.times(by_early)
    slope = late_slope.times(by_late)
    if early_slope is not None:
        slope = slope.plus(early_slope)
    # A tip that stops early counts by the part of the way that it ran.
    end = LATE * rates.shape[1]
    if reach < end:
        factor = reach / end
        slope = slope.times(factor)
        slope.way[-1] += degree / end
        degree *= factor
    if least_points is not None:
        width = slides.length / np.maximum(r, 1e-3)
        narrow = width < least_points
        of_width = _Value(
            np.where(narrow, width, least_points) / least_points,
            np.zeros_like(f),
            np.where(narrow & (r > 1e-3), -width / np.maximum(r, 1e-3), 0.0) / least_points,
            np.where(narrow, 1 / np.maximum(r, 1e-3), 0.0) / least_points,
        )
        factor, of_factor = _mean(slides, of_width, EARLY if mode == "pulses_into_crack" else MIDDLE, LATE)
        slope = slope.times(factor).plus(of_factor.times(degree))
        degree *= factor
    return degree, slides.by_rates(slope)


@dataclass
class _Slope:
    """Derivatives by the sliding fraction, number of zones, length of sliding and way, each of shape (times,)."""

    fraction: Floats
    zones: Floats
    length: Floats
    way: Floats

    def times(self, factor: float) -> _Slope:
        return _Slope(*(factor * each for each in (self.fraction, self.zones, self.length, self.way)))

    def plus(self, other: _Slope) -> _Slope:
        return _Slope(
            self.fraction + other.fraction, self.zones + other.zones, self.length + other.length, self.way + other.way
        )


@dataclass(frozen=True)
class _Value:
    """A degree at every time, with derivatives by the sliding fraction, the number of zones and the sliding length."""

    value: Floats
    by_fraction: Floats
    by_zones: Floats
    by_length: Floats | float = 0.0

    def over(self, other: _Value) -> _Value:
        """Return the product."""
        return _Value(
            self.value * other.value,
            self.value * other.by_fraction + self.by_fraction * other.value,
            self.value * other.by_zones + self.by_zones * other.value,
        )


class _Slides:
    """Degrees to which points slide, and what follows from them at every time.

    Attributes
    ----------
    length, way, fraction, zones : ndarray, shape (times,)
        In distances of points: sliding length, and way of the tip; their ratio; number of zones.
    """

    def __init__(self, rates: Floats, threshold: float, steepness: float) -> None:
        u = np.abs(rates) / threshold
        with np.errstate(over="ignore"):
            power = u**steepness
        self._h = np.where(power < 1e30, power / (1 + power), 1.0)
        self._slope = np.where(u > 0, steepness * self._h * (1 - self._h) / np.maximum(u, 1e-300), 0.0)
        self._slope *= np.sign(rates) / threshold
        largest = np.maximum.accumulate(self._h, axis=0)
        rows = np.arange(len(rates))[:, None]
        self._when = np.maximum.accumulate(np.where(self._h >= largest, rows, 0), axis=0)
        self.length, self.way = self._h.sum(axis=1), largest.sum(axis=1)
        self._span = np.maximum(self.way, 1.0)
        self.fraction = self.length / self._span
        padded = np.pad(self._h, ((0, 0), (1, 1)))
        self._jump = np.diff(padded, axis=1)
        self._size = np.sqrt(self._jump**2 + ROUND**2)
        self.zones = 0.5 * (self._size - ROUND).sum(axis=1)

    def by_rates(self, slope: _Slope) -> Floats:
        """Return the derivative by the slip rates."""
        by_length = slope.length + slope.fraction / self._span
        by_way = slope.way - np.where(self.way > 1.0, slope.fraction * self.fraction / self._span, 0.0)
        by_h = np.tile(by_length[:, None], (1, self._h.shape[1]))
        columns = np.broadcast_to(np.arange(self._h.shape[1]), self._h.shape)
        np.add.at(by_h, (self._when, columns), np.broadcast_to(by_way[:, None], self._h.shape))
        of_jump = 0.5 * slope.zones[:, None] * self._jump / self._size
        by_h += of_jump[:, :-1] - of_jump[:, 1:]
        return np.asarray(by_h * self._slope)


def _mean(slides: _Slides, of: _Value, begin: float, end: float) -> tuple[float, _Slope]:
    """Return the mean of a degree over the times at which the tip is between two parts of its way."""
    reach = max(float(slides.way[-1]), 1e-12)
    part = slides.way / reach
    up, down = _step(part - begin), _step(end - part)
    weight = up * down + 1e-12
    by_part = (up * (1 - up) * down - up * down * (1 - down)) / SOFT
    total = float(weight.sum())
    mean = float(weight @ of.value) / total
    by_weight = (of.value - mean) / total * by_part
    by_way = by_weight / reach
    by_way[-1] -= float(by_weight @ part) / reach
    share = weight / total
    return mean, _Slope(share * of.by_fraction, share * of.by_zones, share * of.by_length, by_way)


def _step(value: Floats) -> Floats:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * value / SOFT)))


def _up_to_one(value: Floats, slope: Floats) -> tuple[Floats, Floats]:
    return np.minimum(value, 1.0), np.where(value < 1.0, slope, 0.0)


def _few(r: Floats, most: float) -> _Value:
    """Return min(1, most / r)."""
    count = np.maximum(r, 1.0)
    value, slope = _up_to_one(most / count, np.where(r > 1.0, -most / count**2, 0.0))
    return _Value(value, np.zeros_like(r), slope)


def _alive(r: Floats) -> _Value:
    value, slope = _up_to_one(r, np.ones_like(r))
    return _Value(value, np.zeros_like(r), slope)


def _crack(f: Floats, r: Floats) -> _Value:
    value, slope = _up_to_one(f / 0.9, np.full_like(f, 1 / 0.9))
    return _Value(value, slope, np.zeros_like(r)).over(_few(r, 2.0))


def _pulse(f: Floats, r: Floats) -> _Value:
    value, slope = _up_to_one((1 - f) / 0.6, np.full_like(f, -1 / 0.6))
    return _Value(value, slope, np.zeros_like(r)).over(_few(r, 3.0)).over(_alive(r))


def _train(f: Floats, r: Floats) -> _Value:
    value, slope = _up_to_one(np.maximum(r - 1, 0.0) / 3, np.where(r > 1, 1 / 3, 0.0))
    return _Value(value, np.zeros_like(f), slope)


def _several(f: Floats, r: Floats) -> _Value:
    """Return the larger degree of a train, and of pulses, of which a single one counts half."""
    counted, slope = np.clip(0.5 * r, 0.5, 1.0), np.where((r > 1) & (r < 2), 0.5, 0.0)
    pulse, train = _pulse(f, r).over(_Value(counted, np.zeros_like(f), slope)), _train(f, r)
    more = train.value > pulse.value
    return _Value(
        np.where(more, train.value, pulse.value),
        np.where(more, train.by_fraction, pulse.by_fraction),
        np.where(more, train.by_zones, pulse.by_zones),
    )


_DEGREES = {"crack": _crack, "pulse": _pulse, "train": _train}
