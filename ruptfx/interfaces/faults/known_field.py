"""Known fields of an interface: a profile times a history, or values over time and position from a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from ruptfx.bodies.boundaries.histories import History, course
from ruptfx.input.number_files import read_table
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fields import Contribution, Heating
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.laws.friction.time_weakening import weakened_fraction

SIGNS = {"begin": 1.0, "end": -1.0}
"""Change of the share of a field at each of its times."""
TIMES = (*SIGNS, "rise")
SUDDEN = 1e-30  # s, as `weakened_fraction`


class KnownTable(Protocol):
    """A table of a known field has these keys, and one for its profile."""

    @property
    def history(self) -> History | None: ...
    @property
    def file(self) -> str | None: ...


def require_one_source(name: str, profile: object, table: KnownTable) -> None:
    """Refuse a table with a profile and a file, with none of them, or with a file and a history.

    Raises
    ------
    ValueError
    """
    if (profile is None) == (table.file is None):
        raise ValueError(f"{name}, file: give one of them")
    if table.file is not None and table.history is not None:
        raise ValueError(f"history: the file has values over time; remove it, or give {name} instead of file")


class KnownField(Contribution):
    """A field that depends on time and place only: a course, between two times where these are given.

    Parameters
    ----------
    name : str
    at : callable, time -> ndarray, shape (n,)
        Course of the field, of that of a unit profile where there is one.
    parameters : dict of ndarray, shape (n,)
        The profile by its key, and `begin`, `end` and `rise` [s] where the field acts for a time.
    """

    def __init__(
        self, name: str, at: Callable[[float], np.ndarray], parameters: Mapping[str, np.ndarray] | None = None
    ) -> None:  # fmt: skip
        self.adds = (name,)
        self._at, self.parameters = at, dict(parameters or {})
        self._profile = next((key for key in self.parameters if key not in TIMES), None)

    @classmethod
    def of(
        cls, name: str, unit: str, profile: np.ndarray | float | None, table: KnownTable, face: Interface, key: str
    ) -> Self:  # fmt: skip
        """Return the field of a table, from its file or from a profile that is evaluated at the points.

        Raises
        ------
        CaseError
            As `of_file`.
        """
        if table.file is not None:
            return cls.of_file(name, table.file, unit, face, key)
        assert profile is not None  # `require_one_source`
        key = "temperature" if name == "temperature" else "pressure"
        return cls.of_profile(name, key, profile, table.history, len(face.plus))

    @classmethod
    def of_profile(
        cls, name: str, key: str, profile: np.ndarray | float, history: History | None, points: int
    ) -> Self:  # fmt: skip
        """Return a profile, evaluated at the points, times a history."""
        values, one = np.broadcast_to(profile, points), np.ones(points)
        return cls(name, lambda time: one * course(time, 0.0, history), {key: values})

    @classmethod
    def of_file(cls, name: str, file: str, unit: str, face: Interface, key: str) -> Self:
        """Return the interpolation of a file with time, position and value at the points of a grid.

        Raises
        ------
        CaseError
            A file that has other columns, no grid, or does not cover the interface.
        """
        try:
            times, positions, values = read_grid(Path(file), unit)
        except ValueError as error:
            raise CaseError(f"{key}.file: {error}") from None
        first, last = face.line.first, face.line.last
        slack = 1e-9 * (last - first)
        if first < positions[0] - slack or last > positions[-1] + slack:
            raise CaseError(
                f"{key}.file = '{file}': has positions from {positions[0]:.6g} to {positions[-1]:.6g} m, and the "
                f"interface is from {first:.6g} to {last:.6g} m; add to the file"
            )
        rows = np.stack([np.interp(face.position, positions, row) for row in values])

        def at(time: float) -> np.ndarray:
            i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2))
            part = np.clip((time - times[i]) / (times[i + 1] - times[i]), 0.0, 1.0)
            return np.asarray((1 - part) * rows[i] + part * rows[i + 1])

        return cls(name, at)

    def between(
        self, begin: np.ndarray | float | None, end: np.ndarray | float | None, rise: np.ndarray | float
    ) -> Self:  # fmt: skip
        """Return the field between two times [s], with linear rise and fall; None is before or after all times."""
        changes = {name: time for name, time in (("begin", begin), ("end", end)) if time is not None}
        if not changes:
            return self
        points = np.shape(self._at(0.0))
        times = {name: np.broadcast_to(value, points) for name, value in (changes | {"rise": rise}).items()}
        return type(self)(self.adds[0], self._at, {**self.parameters, **times})

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        now = time + heating.elapsed
        return {self.adds[0]: self._share(now) * self._size(now)}

    def _size(self, time: float) -> np.ndarray:
        """Return the field without its begin and end, shape (n,)."""
        return self._at(time) * (1.0 if self._profile is None else self.parameters[self._profile])

    def _share(self, time: float) -> np.ndarray:
        """Return the part of the field that acts at a time [s]."""
        changes = [(sign, self.parameters[name]) for name, sign in SIGNS.items() if name in self.parameters]
        parts = (sign * weakened_fraction(time, change, self.parameters["rise"]) for sign, change in changes)
        return np.asarray(sum(parts, float("begin" not in self.parameters)))

    def slopes(self, time: float) -> dict[str, np.ndarray]:
        """Return the derivatives of the field by its parameters; a sudden rise has none by its times."""
        share = np.broadcast_to(self._share(time), np.shape(self._at(time)))
        slopes = {} if self._profile is None else {self._profile: share * self._at(time)}
        names = [name for name in SIGNS if name in self.parameters]
        if not names:
            return slopes
        size, rise = self._size(time), np.maximum(self.parameters["rise"], SUDDEN)
        slopes["rise"] = np.zeros_like(size)
        for name in names:
            part = (time - self.parameters[name]) / rise
            slopes[name] = -SIGNS[name] * np.where((part > 0) & (part < 1), size / rise, 0.0)
            slopes["rise"] += slopes[name] * part
        return slopes

    def with_changes(self, changes: Mapping[str, np.ndarray]) -> Self:
        values = {name: value + changes.get(name, 0.0) for name, value in self.parameters.items()}
        return type(self)(self.adds[0], self._at, values)


def read_grid(path: Path, unit: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], positions [m] and values of a CSV file, shape (times, positions).

    Raises
    ------
    ValueError
    """
    table = read_table(path)
    if table.width != 3:
        raise ValueError(f"line {table.lines[0]} of {path}: {table.width} columns; give three: time, position, value")
    scales = table.factors({0: "s", 1: "m", 2: unit})
    columns = [table.column(i, scale or 1) for i, scale in scales.items()]
    (times, i), (positions, k) = (np.unique(column, return_inverse=True) for column in columns[:2])
    count = np.zeros((len(times), len(positions)), dtype=int)
    np.add.at(count, (i, k), 1)
    if len(times) < 2 or len(positions) < 2 or count.min() != 1 or count.max() != 1:
        raise ValueError(
            f"{path}: {len(columns[0])} lines for {len(times)} times and {len(positions)} positions; give one line for "
            "each combination of at least two times and two positions"
        )
    values = np.empty(count.shape)
    values[i, k] = columns[2]
    return times, positions, values
