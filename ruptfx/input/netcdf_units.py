"""Variables of NetCDF files with their units, packed values and grids."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.quantities import factor
from ruptfx.platform.files import require_file

if TYPE_CHECKING:
    import h5netcdf
    import xarray

MOST_VALUES = 100_000_000  # of a variable, 0.8 GB; compressed, a small file may claim any number


class Grid(NamedTuple):
    """A variable on a grid: names and increasing coordinates [m] of its axes, and values, in the order of the axes."""

    names: list[str]
    coordinates: list[np.ndarray]
    values: np.ndarray


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Convert all errors of damaged files, of which libraries raise many kinds, to one that names the file.

    Raises
    ------
    ValueError
    """
    require_file(path, remedy="give a NetCDF file")
    try:
        yield
    except Exception as error:
        if isinstance(error, ValueError | RuptfxError) and str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: cannot be read as NetCDF ({error!s:.200}); give a NetCDF file") from None


@contextmanager
def opened(path: Path) -> Iterator[h5netcdf.File]:
    """Open a NetCDF 4 file.

    Raises
    ------
    ValueError
        It cannot be read, or is no regular file.
    """
    import h5netcdf
    import h5py

    # HDF5 gives the old content to who opens a file once more: it is closed whatever fails.
    with _readable(path), h5py.File(path, "r", locking=False) as raw:
        raw.attrs.get("_nc3_strict")  # first: h5netcdf prints a traceback where it cannot read this
        with h5netcdf.File(raw, "r") as file:
            yield file


@contextmanager
def _opened_grid(path: Path, variable: str | None) -> Iterator[xarray.DataArray]:
    """Open a variable of a NetCDF file of any version; without a name the only one.

    Raises
    ------
    ValueError
    """
    import h5py
    import xarray

    with _readable(path), ExitStack() as stack:
        source: Any = path
        if h5py.is_hdf5(path):
            file = stack.enter_context(opened(path))
            for name, item in file.variables.items():  # coordinates are read when xarray opens the file
                if item.ndim == 1 or name == variable:
                    require_size(path, name, item.shape)
            source = xarray.backends.H5NetCDFStore(file)
        with xarray.open_dataset(source, decode_times=False, decode_timedelta=False) as data:
            names = [str(name) for name in data.data_vars]
            if variable is None and len(names) == 1:
                variable = names[0]
            if variable not in names:
                asked = "give variable" if variable is None else f"no variable '{variable}'; give another one"
                raise ValueError(f"{path}: {asked}, one of {', '.join(names) or 'none that it has'}")
            require_size(path, variable, data[variable].shape)
            yield data[variable]


def require_size(path: Path, name: str, shape: Sequence[int], most: int = MOST_VALUES) -> None:
    """Refuse a variable with too many values, before it is read.

    Raises
    ------
    ValueError
    """
    if (count := math.prod(map(int, shape))) > most:
        raise ValueError(f"{path}: '{name}' has {count:g} values, and variables at most {most:g}; leave out values")


def check_grid(path: Path, variable: str, axes: Sequence[str], unit: str) -> None:
    """Refuse units of a variable and of its axes that are unknown or of another kind, without reading its values.

    Raises
    ------
    ValueError
    """
    with _opened_grid(path, variable) as result:
        for name in result.dims:
            if name in axes and name in result.coords:
                _factor(path, str(name), result[name].attrs, "m")
        _factor(path, variable, result.attrs, unit)


def read_grid(
    path: Path, variable: str | None, axes: Sequence[str], unit: str | None, most: int = MOST_VALUES,
    of_axes: str | None = "m",
) -> Grid:  # fmt: skip
    """Return a variable on a grid, in the units of its attributes `units`.

    Parameters
    ----------
    variable : str or None
        Its name; None if the file has one only.
    axes : sequence of str
        Axes that it may have, in this order in the result.
    unit : str or None
        Unit of the values; None for the SI unit. Values without attribute are in it, coordinates in m.
    most : int
        Largest number of values.
    of_axes : str or None
        Unit of coordinates; None if they have none, as longitudes.

    Raises
    ------
    ValueError
        The file cannot be read, has too many values, other axes, a unit that is unknown or of another kind, or missing
        values.
    """
    with _opened_grid(path, variable) as result:
        name = str(result.name)
        require_size(path, name, result.shape, most)
        dims = [axis for axis in axes if axis in result.dims]
        has_other = len(dims) < len(result.dims) or any(axis not in result.coords for axis in dims)
        if has_other or not dims:
            shown = ", ".join(map(str, result.dims)) or "none"
            raise ValueError(f"{path}: '{name}' has the axes {shown}; give it {', '.join(axes)} with coordinates")
        result = result.load().transpose(*dims).sortby(dims)
        coordinates = []
        for axis in dims:
            positions = np.asarray(result[axis].values, dtype=float)
            positions = positions * (_factor(path, axis, result[axis].attrs, of_axes) if of_axes else 1.0)
            if len(positions) < 2 or not np.all(np.diff(positions) > 0):
                raise ValueError(f"{path}: {axis} needs two positions or more, each given once")
            coordinates.append(positions)
        values = np.asarray(result.values, dtype=float) * _factor(path, name, result.attrs, unit)
    if not np.isfinite(values).all():
        raise ValueError(f"{path}: '{name}' has values that are missing or not finite; fill them")
    return Grid(dims, coordinates, values)


def _factor(path: Path, name: str, attributes: Mapping[str, object], unit: str | None) -> float:
    """Return the factor to a unit; one without an attribute `units`."""
    return unit_and_factor(path, name, attributes, unit)[1] if str(attributes.get("units", "")).strip() else 1.0


def unit_and_factor(path: Path, name: str, attributes: Mapping[str, object], unit: str | None) -> tuple[str, float]:
    """Return the unit of a variable and its factor to another unit.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        The variable.
    attributes : mapping of str to object
        Attributes of the variable.
    unit : str or None
        Target unit; None for the SI unit.

    Raises
    ------
    ValueError
        No unit, an unknown one, or one of another kind.
    """
    if "units" not in attributes:
        raise ValueError(f"{path}: '{name}' has no unit; give it an attribute units")
    text = str(attributes["units"])
    try:
        return text, float(factor(text, unit))
    except ValueError as error:
        wanted = f", write {unit} or a multiple" if unit else ""
        raise ValueError(f"{path}: '{name}' has units = '{text}': {error}; correct this attribute{wanted}") from None


def unpacked(path: Path, variable: h5netcdf.Variable, most: int = MOST_VALUES) -> np.ndarray:
    """Return the numbers of a variable in its unit, NaN where they are missing.

    The attributes `_FillValue` and `missing_value` name stored values that are missing; the others are multiplied by
    `scale_factor`, and `add_offset` is added (CF conventions).

    Raises
    ------
    ValueError
        Too many numbers.
    """
    require_size(path, str(variable.name).lstrip("/"), variable.shape, most)
    stored, attributes = np.asarray(variable[...]), variable.attrs
    scale, offset = float(attributes.get("scale_factor", 1.0)), float(attributes.get("add_offset", 0.0))
    values = stored.astype(float) * scale + offset
    for name in ("_FillValue", "missing_value"):
        if name in attributes:
            values[np.isin(stored, attributes[name])] = np.nan
    return values
