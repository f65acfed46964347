"""Time histories that boundaries share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field, Tag, model_validator

from ruptfx.input.schema import Part, Unit, by_kind, shown_value
from ruptfx.input.units import Time

Times = TypeVar("Times", float, np.ndarray)


def ramp(time: float, duration: float) -> float:
    """Return the linear growth from 0 to 1 over a duration."""
    return 1.0 if duration <= 0 else min(max(time / duration, 0.0), 1.0)


@dataclass(frozen=True)
class Samples:
    """Sampled time history of a boundary, as `ruptfx check` shows it.

    Attributes
    ----------
    times, values : list of float
        The samples; times increase [s].
    unit : str
        Of the values, ``1`` for a factor.
    at : callable
        Value at a time [s]; between samples it stays between theirs.
    constant_after : bool
        Whether a constant value after the last sample is intended.
    file : str
        File that the samples were read from, as the case names it; empty where the case has the numbers.
    """

    times: list[float]
    values: list[float]
    unit: str
    at: Callable[[float], float]
    constant_after: bool
    file: str = ""

    def until(self, end: float) -> tuple[float, float]:
        """Return the smallest and the largest value from time zero to `end` [s]."""
        within = [value for time, value in zip(self.times, self.values, strict=True) if 0 <= time <= end]
        seen = [*within, self.at(0.0), self.at(end)]
        return min(seen), max(seen)


class Ricker(Part):
    """Ricker wavelet (1 - 2 a) exp(-a), a = (pi frequency (t - delay))^2."""

    kind: Literal["ricker"]
    frequency: Annotated[float, Field(gt=0), Unit("1/s")]
    """Frequency of the peak of the spectrum."""
    delay: Time
    """Time of the peak; with at least 1.5 / frequency the wavelet starts smoothly."""

    def __call__(self, time: Times) -> Times:
        """Return the wavelet at a time [s] or an array of times."""
        a = (np.pi * self.frequency * (time - self.delay)) ** 2
        return (1 - 2 * a) * np.exp(-a)


class Sampled(Part):
    """Linear interpolation between given times, constant beyond the ends."""

    kind: Literal["sampled"]
    times: Annotated[list[float], Field(min_length=2), Unit("s")]
    """At least two, increasing."""
    values: Annotated[list[float], Field(min_length=2), Unit("1")]
    """One for each time."""

    @model_validator(mode="after")
    def _matching(self) -> Sampled:
        if len(self.values) != len(self.times) or np.any(np.diff(self.times) <= 0):
            raise ValueError(
                f"times = {shown_value(self.times)}: must increase, with one value for each, here {len(self.values)}"
            )
        return self

    def __call__(self, time: Times) -> Times:
        """Return the factor at a time [s] or an array of times."""
        return np.interp(time, self.times, self.values)

    @property
    def samples(self) -> Samples:
        return Samples(self.times, self.values, "1", lambda time: float(self(time)), constant_after=True)


History = Annotated[
    Annotated[Ricker, Tag("<ricker>")] | Annotated[Sampled, Tag("<sampled>")], by_kind("ricker", "sampled")
]
"""A factor in time."""


def course(time: float, duration: float, history: Ricker | Sampled | None) -> float:
    """Return the product of a linear ramp and a history, if there is one, at a time [s]."""
    return ramp(time, duration) * (float(history(time)) if history is not None else 1.0)
