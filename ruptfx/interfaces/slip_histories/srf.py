"""Finite-fault models in the Standard Rupture Format."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.input.number_files import number, text_of
from ruptfx.interfaces.slip_histories._subfaults import MOST_SUBFAULTS, FiniteFault, Model
from ruptfx.platform.files import read_once

MOST_SAMPLES = 50_000_000
AGREES = 0.05
"""Difference between the slip of a subfault and the sum of its slip rates, over the largest slip, that is rounding."""


class Srf(FiniteFault):
    """A plane of a finite-fault model in the Standard Rupture Format (SRF) of SCEC, version 1.0 or 2.0.

    The subfaults have slip rates along rake and rake + 90 degrees, sampled in time; between the samples, and over one
    interval before the first and after the last, they are linear: their sum times the interval is the slip. Opening
    (`SLIP3`) is refused.
    Source: Graves (2014), Standard Rupture Format.
    """

    source: ClassVar[str] = "Graves (2014), Standard Rupture Format"
    example: ClassVar[str] = '{ kind = "srf", file = "model.srf" }'
    files_of_example: ClassVar[dict[str, str]] = {"model.srf": (
        "1.0\nPLANE 1\n-118.0 34.0 2 1 0.000004 0.000002\n0 90 0.0 0.0 0.000001\nPOINTS 2\n"
        "-118.0 34.0 0.000001 0 90 4e-2 0.0 1e-7\n0 1e-4 3 0 0 0 0\n0 1e3 0\n"
        "-118.0 34.0 0.000001 0 90 4e-2 1e-7 1e-7\n0 1e-4 3 0 0 0 0\n0 1e3 0\n"
    )}  # fmt: skip

    plane: Annotated[int, Field(ge=0)] = 0
    """Number of the plane in a file with several, from 0; each interface takes one."""

    def model(self) -> Model:
        return _read(self.file, self.plane)


class Words:
    """Numbers of a text with their lines, one after the other."""

    def __init__(self, path: Path) -> None:
        self.path, self.line = path, 0
        self._words = self._all(text_of(path))

    def _all(self, text: str) -> Iterator[tuple[int, str]]:
        for line, content in enumerate(text.splitlines(), 1):
            if not content.lstrip().startswith("#"):
                yield from ((line, word) for word in content.split())

    def word(self, meaning: str) -> str:
        """Return the next word.

        Raises
        ------
        ValueError
        """
        item = next(self._words, None)
        if item is None:
            raise ValueError(
                f"{self.path}: ends after line {self.line}, where {meaning} should follow; the file is cut off, "
                "use the original one"
            )
        self.line, word = item
        return word

    def value(self, meaning: str) -> float:
        """Return the next number."""
        word = self.word(meaning)
        try:
            return number(word, self.path, self.line)
        except ValueError:
            raise self.wrong(f"{meaning} = {word[:40]!r} must be a finite number") from None

    def values(self, *meanings: str) -> list[float]:
        """Return the next numbers."""
        return [self.value(meaning) for meaning in meanings]

    def count(self, meaning: str, least: int, most: int) -> int:
        """Return the next number, an integer between two bounds."""
        value = self.value(meaning)
        if value != int(value) or not least <= value <= most:
            raise self.wrong(f"{meaning} = {value:g} must be an integer from {least} to {most}")
        return int(value)

    def wrong(self, what: str) -> ValueError:
        """Return the error of the current line."""
        return ValueError(f"line {self.line} of {self.path}: {what}")


class Sampled:
    """Slip of subfaults by slip rates that are linear between their samples, with zeros at both ends.

    Attributes
    ----------
    dt : ndarray, shape (n,)
        Interval [s]; the zero before the first sample is at time 0.
    """

    def __init__(self, dt: list[float], rates: list[list[float]]) -> None:
        self.dt = np.array(dt)
        padded = [np.concatenate([[0.0], each, [0.0]]) if each else np.zeros(2) for each in rates]
        self._first = np.concatenate([[0], np.cumsum([len(each) for each in padded])])[:-1]
        self._last = np.array([len(each) for each in padded]) - 1
        self._rates = np.concatenate(padded)
        self._slip = np.concatenate([
            np.concatenate([[0.0], np.cumsum(0.5 * (each[1:] + each[:-1]))]) * dt
            for each, dt in zip(padded, self.dt, strict=True)
        ])  # fmt: skip

    @property
    def final(self) -> np.ndarray:
        """Final slip, shape (n,)."""
        return self._slip[self._first + self._last]

    def at(self, number: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return slip and slip rate of some histories at times since their start, shape (n,)."""
        dt, last = self.dt[number], self._last[number]
        x = np.clip(time / dt, 0.0, last)
        i = np.minimum(np.floor(x).astype(int), last - 1)
        part, at = x - i, self._first[number] + i
        rate = self._rates[at] + part * (self._rates[at + 1] - self._rates[at])
        return self._slip[at] + 0.5 * part * (self._rates[at] + rate) * dt, rate


@read_once
def _read(file: str, plane: int) -> Model:
    words = Words(Path(file))
    version = words.word("the version")
    if version not in ("1.0", "2.0"):
        raise words.wrong(f"version '{version[:20]}': must be 1.0 or 2.0")
    if (word := words.word("PLANE")) != "PLANE":
        raise words.wrong(f"'{word[:20]}': the header PLANE must follow, with length and width of the subfaults")
    planes = []
    for _ in range(words.count("number of planes", 1, 1000)):
        words.values("ELON", "ELAT")
        along, down = (words.count(name, 1, MOST_SUBFAULTS) for name in ("NSTK", "NDIP"))
        size = words.values("LEN", "WID")
        if min(size) <= 0:
            raise words.wrong(f"LEN = {size[0]:g} and WID = {size[1]:g} km must be positive")
        words.values("STK", "DIP", "DTOP", "SHYP", "DHYP")
        planes.append((along, down, 1e3 * size[0] / along, 1e3 * size[1] / down))
    if plane >= len(planes):
        raise ValueError(f"{words.path}: has {len(planes)} planes, and plane = {plane} counts from 0; give one of them")
    points = _points(words, version, sum(along * down for along, down, _, _ in planes))
    skipped = sum(along * down for along, down, _, _ in planes[:plane])
    along, down, length, width = planes[plane]
    some = points[skipped : skipped + along * down]
    series = [Sampled([each[3] for each in some], [each[k] for each in some]) for k in (1, 2)]  # type: ignore[misc]

    def course(number: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (slip, rate), (slip_aside, rate_aside) = (each.at(number, time) for each in series)
        return np.stack([slip, slip_aside]), np.stack([rate, rate_aside])

    rake, onset = (np.array([each[k] for each in some]).reshape(down, along) for k in (0, 4))
    final = np.any([each.final != 0 for each in series], axis=0).reshape(down, along)
    return Model(length, width, rake, onset, final, course)


Point = tuple[float, list[float], list[float], float, float]


def _points(words: Words, version: str, count: int) -> list[Point]:
    """Return rake, slip rates along both directions [m/s], interval and start [s] of all points."""
    points: list[Point] = []
    samples, sums = 0, []
    while len(points) < count:
        if (word := words.word("POINTS")) != "POINTS":
            raise words.wrong(f"'{word[:20]}': POINTS must follow")
        here = words.count("number of points", 1, MOST_SUBFAULTS)
        if len(points) + here > count:
            raise words.wrong(
                f"{len(points) + here} points, and the planes have NSTK x NDIP = {count}; correct one of them"
            )
        for _ in range(here):
            *_, start, dt = words.values("LON", "LAT", "DEP", "STK", "DIP", "AREA", "TINIT", "DT")
            if version == "2.0":
                words.values("VS", "DEN")
            if dt <= 0 or start < 0:
                raise words.wrong(f"TINIT = {start:g} s must not be negative, and DT = {dt:g} s must be positive")
            rake, numbers, slips = words.value("RAKE"), [], []
            for k in (1, 2, 3):
                slips.append(0.01 * words.value(f"SLIP{k}"))
                numbers.append(words.count(f"NT{k}", 0, MOST_SAMPLES))
            if numbers[2] or slips[2]:
                raise words.wrong("SLIP3: opening is not prescribed; leave it out")
            samples += sum(numbers)
            if samples > MOST_SAMPLES:
                raise words.wrong(f"more than {MOST_SAMPLES:g} samples; use fewer or longer intervals")
            rates = [[0.01 * words.value(f"SR{k + 1}") for _ in range(numbers[k])] for k in range(2)]
            sums.append([(slips[k], dt * sum(rates[k]), words.line) for k in range(2)])
            points.append((rake, rates[0], rates[1], dt, start - dt))
    largest = max(abs(slip) for each in sums for slip, _, _ in each)
    for slip, total, line in (item for each in sums for item in each):
        if abs(slip - total) > AGREES * largest:
            raise ValueError(
                f"line {line} of {words.path}: slip rates times DT add up to {100 * total:.4g} cm, and the slip is "
                f"{100 * slip:.4g} cm; correct DT or the units (cm, cm/s)"
            )
    return points
