"""Named arrays of a file, read on demand: the subset of `xarray.Dataset` used by figures and analysis.

The import of xarray takes longer than all reading at the end of a run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

Array = np.ndarray
Rows = int | slice | Array


class Stored(Protocol):
    """An array in memory or in a file."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, rows: Any) -> Any: ...


class Column:
    """One array.

    Parameters
    ----------
    dims : tuple of str
        Names of its axes.
    attrs : mapping, optional
        Attributes in the file, for example units.
    rows : range, optional
        Rows of the first axis to use; default is all.
    """

    def __init__(
        self, stored: Stored, dims: tuple[str, ...], attrs: Mapping[str, Any] = MappingProxyType({}),
        rows: range | None = None,
    ) -> None:  # fmt: skip
        self.dims, self.attrs, self._stored = dims, attrs, stored
        self._rows = range(stored.shape[0] if stored.shape else 0) if rows is None else rows

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return (len(self._rows), *self._stored.shape[1:]) if self.dims else ()

    @cached_property
    def values(self) -> Array:
        """The array, in memory from the first access on."""
        rows = self._rows
        return np.asarray(self._stored[slice(rows.start, rows.stop, rows.step)] if self.dims else self._stored[()])

    def isel(self, time: Rows = slice(None), position: Rows = slice(None)) -> Column:
        """Return the column at some times and positions, by index; unchanged without these axes."""
        if "position" in self.dims and not (isinstance(position, slice) and position == slice(None)):
            picked = np.take(self.values, np.arange(self.shape[self.dims.index("position")])[position],
                             self.dims.index("position"))  # fmt: skip
            return Column(picked, self.dims, self.attrs).isel(time)
        if "time" not in self.dims:
            return self
        if isinstance(time, slice):
            return Column(self._stored, self.dims, self.attrs, self._rows[time])
        if np.ndim(time) == 0:
            return Column(np.asarray(self._stored[self._rows[int(time)]]), self.dims[1:], self.attrs)
        return Column(self.values[time], self.dims, self.attrs)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.values, dtype=dtype, copy=copy)


class Columns(Mapping[str, Column]):
    """Arrays by name, with the attributes of the file."""

    def __init__(self, columns: dict[str, Column], attrs: Mapping[str, Any]) -> None:
        self._columns, self.attrs = columns, attrs

    def __getitem__(self, name: str) -> Column:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of all axes, by name."""
        return {dim: size for column in self.values() for dim, size in zip(column.dims, column.shape, strict=True)}

    def rename(self, names: Mapping[str, str]) -> Columns:
        """Return the same columns, some of them by other names."""
        return Columns({names.get(name, name): column for name, column in self.items()}, self.attrs)

    def isel(self, time: slice = slice(None), position: Rows = slice(None)) -> Columns:
        """Return all columns at some times and positions."""
        return Columns({name: column.isel(time, position) for name, column in self.items()}, self.attrs)
