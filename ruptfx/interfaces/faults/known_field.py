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
    """A field that depends on time and place only.

    Parameters
    ----------
    name : str
    at : callable, time -> ndarray, shape (n,)
    """

    def __init__(self, name: str, at: Callable[[float], np.ndarray]) -> None:
        self.adds = (name,)
        self._at = at

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
        return cls.of_profile(name, profile, table.history, len(face.plus))

    @classmethod
    def of_profile(cls, name: str, profile: np.ndarray | float, history: History | None, points: int) -> Self:
        """Return a profile, evaluated at the points, times a history."""
        values = np.broadcast_to(profile, points)
        return cls(name, lambda time: values * course(time, 0.0, history))

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
        at, times = self._at, [(1.0, begin), (-1.0, end)]
        changes = [(sign, time) for sign, time in times if time is not None]

        def factor(time: float) -> np.ndarray:
            parts = [np.asarray(sign * weakened_fraction(time, change, rise)) for sign, change in changes]
            return np.asarray(sum(parts) + float(begin is None))

        return type(self)(self.adds[0], lambda time: factor(time) * at(time)) if changes else self

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        return {self.adds[0]: self._at(time + heating.elapsed)}


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
