"""Arrays of files of laboratories by name: text, NetCDF, HDF5 and MATLAB files, folders with one file per event.

`contents` lists the arrays with shapes and units; `mapped` reads times and channels by a mapping: a table with the
entry `time` and one for each channel, which name an array, its column, unit and sign.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from ruptfx.input.netcdf_units import require_size
from ruptfx.input.number_files import MOST_LINES, name_and_factor, read_table, require_increasing
from ruptfx.input.quantities import factor
from ruptfx.input.schema import Part, load_toml_file, nearest
from ruptfx.input.units import Frequency, Instant
from ruptfx.platform.files import require_file

TEXT = (".csv", ".txt", ".dat", ".asc", ".tsv")
BINARY = (".nc", ".h5", ".hdf5", ".mat")
_BRACKETED = re.compile(r"(.*?)[\s/]*[(\[]([^()\[\]]*)[)\]]")


class Column(Part):
    """Place of one quantity in a file: an array, or samples at a rate for the time."""

    variable: str | None = None
    """Name of the array or of a column of text, with its groups, as `run1/strain`."""
    column: Annotated[int, Field(ge=1)] = 1
    """Number of the channel in an array of several, from 1."""
    unit: str | None = None
    """Unit of the numbers; default is the one that is stored beside them."""
    sign: Literal[-1, 1] = 1
    """-1 where the file has the other sign."""
    rate: Frequency | None = None
    """Sampling rate of the time, in place of an array."""
    start: Instant = 0.0
    """Time of the first sample at a rate [s]."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.variable is None) == (self.rate is None):
            raise ValueError("give either variable, the name of an array, or rate, a frequency for the time")
        return self


class Variable(NamedTuple):
    """Array of a file: name, shape with the times first, unit (empty without one) and numbers."""

    name: str
    shape: tuple[int, ...]
    unit: str
    values: np.ndarray


def contents(path: Path) -> list[Variable]:
    """Return the arrays of numbers of a file, of at most two dimensions.

    Raises
    ------
    ValueError
        The file cannot be read, or its format is not known.
    """
    require_file(path)
    ending = path.suffix.lower()
    if ending in TEXT:
        return _of_text(path)
    if ending not in BINARY:
        raise ValueError(f"{path}: '{ending}' is no ending of a data file; use one of {', '.join((*TEXT, *BINARY))}")
    import h5py

    try:
        if h5py.is_hdf5(path):
            return _of_hdf5(path)
        return _of_matlab(path) if ending == ".mat" else _of_netcdf(path)
    except Exception as error:
        if isinstance(error, ValueError) and str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: cannot be read ({error!s:.200}); give a complete file") from None


def _of_text(path: Path) -> list[Variable]:
    table = read_table(path)
    header = table.headers[-1][1] if table.headers else []
    result = []
    for place in range(table.width):
        cell = header[place] if header else f"column {place + 1}"
        name, unit = _name_and_unit(cell)
        values = np.array(table.column(place, gaps=True))
        result.append(Variable(name, values.shape, unit, values))
    return result


def _name_and_unit(cell: str) -> tuple[str, str]:
    """Return name and unit of a header; the unit is empty where it has none that is known."""
    if match := _BRACKETED.fullmatch(cell.strip()):
        return match[1].strip() or cell, _known(match[2].strip())
    for kind in ("s", "m", "m/s", "Pa", "N", "1"):
        try:
            name, scale = name_and_factor(cell, kind)
        except ValueError:
            continue
        if scale is not None:
            return name or cell, _known(cell.strip()[len(name) :].strip(" _/"))
    return cell.strip(), ""


def _known(unit: str) -> str:
    try:
        factor(unit, None)
    except ValueError:
        return ""
    return unit


def _of_hdf5(path: Path) -> list[Variable]:
    """Return the arrays of an HDF5 file; those of MATLAB 7.3 are stored with their axes in reverse order."""
    import h5py

    result: list[Variable] = []
    with h5py.File(path, "r", locking=False) as file:

        def add(name: str, item: object) -> None:
            if not isinstance(item, h5py.Dataset) or name.startswith("#") or item.dtype.kind not in "iuf":
                return
            matlab = item.attrs.get("MATLAB_class")
            if matlab in (b"char", b"cell") or item.attrs.get("MATLAB_empty") or not 0 < item.ndim <= 2:
                return
            require_size(path, name, item.shape)
            values = np.asarray(item[()], dtype=float)
            unit = item.attrs.get("units", item.attrs.get("unit", ""))
            text = unit.decode() if isinstance(unit, bytes) else str(unit)
            result.append(_variable(name, values if matlab is None else values.T, text))

        file.visititems(add)
    return result


def _of_matlab(path: Path) -> list[Variable]:
    from scipy.io import loadmat  # files before version 7.3

    arrays = loadmat(path)
    return [
        _variable(name, np.asarray(values, float), "")
        for name, values in arrays.items()
        if not name.startswith("__") and isinstance(values, np.ndarray) and values.dtype.kind in "iuf"
        and 0 < values.ndim <= 2 and values.size
    ]  # fmt: skip


def _of_netcdf(path: Path) -> list[Variable]:
    import xarray

    with xarray.open_dataset(path, decode_times=False) as data:
        return [
            _variable(str(name), np.asarray(each.values, float), str(each.attrs.get("units", "")))
            for name, each in data.variables.items() if each.dtype.kind in "iuf" and 0 < each.ndim <= 2
        ]  # fmt: skip


def _variable(name: str, values: np.ndarray, unit: str) -> Variable:
    """Return a variable; vectors lose their second axis, and the longer axis of a matrix is that of the times."""
    values = values.ravel() if 1 in values.shape else values
    values = values.T if values.ndim == 2 and values.shape[1] > values.shape[0] else values
    return Variable(name, values.shape, _known(unit.strip()) if unit.strip() else "", values)


def mapped(
    path: Path, columns: Mapping[str, Column], known: Sequence[Variable] | None = None, gaps: bool = False
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, str]]:
    """Return times [s], channels and their units, of a file and a mapping.

    Parameters
    ----------
    path : Path
    columns : mapping of str to Column
        `time`, and the channels by name.
    known : sequence of Variable, optional
        Contents of the file, if it was read before.
    gaps : bool
        Whether channels may have samples that are not a number.

    Raises
    ------
    ValueError
        No such array or column, no unit, another length than that of the time, times that do not increase, or numbers
        that are not finite.
    """
    variables = {each.name: each for each in (contents(path) if known is None else known)}
    channels = {name: each for name, each in columns.items() if name != "time"}
    if "time" not in columns or not channels:
        raise ValueError(f"{path}: a mapping needs time and one channel or more; add them")
    data, units = {}, {}
    for name, column in channels.items():
        data[name], units[name] = _numbers(path, variables, name, column, gaps=gaps)
    count = len(next(iter(data.values())))
    time = columns["time"]
    if time.rate is not None:
        times = time.start + np.arange(count) / time.rate
    else:
        numbers, unit = _numbers(path, variables, "time", time, "s")
        times = numbers * float(factor(unit, "s"))
    for name, values in data.items():
        if len(values) != len(times):
            raise ValueError(f"{path}: map.{name} has {len(values)} samples and the time {len(times)}; give arrays of "
                             "one length")  # fmt: skip
    require_increasing(times, range(1, len(times) + 1), path)
    return times, data, units


def _numbers(
    path: Path, variables: Mapping[str, Variable], name: str, column: Column, unit: str | None = None,
    gaps: bool = False,
) -> tuple[np.ndarray, str]:  # fmt: skip
    if column.variable is None or column.variable not in variables:
        hint = nearest(str(column.variable), list(variables))
        raise ValueError(f"{path}: map.{name}.variable = '{column.variable}': no such array, {hint}")
    variable = variables[column.variable]
    width = variable.shape[1] if len(variable.shape) == 2 else 1
    if column.column > width:
        raise ValueError(f"{path}: map.{name}.column = {column.column}: '{variable.name}' has {width}; use one of them")
    text = column.unit or variable.unit
    if not text:
        raise ValueError(f"{path}: map.{name}: '{variable.name}' has no unit; add unit, such as unit = 'um/m'")
    try:
        factor(text, unit)
    except ValueError as error:
        raise ValueError(f"{path}: map.{name}.unit = '{text}': {error}") from None
    values = variable.values if variable.values.ndim == 1 else variable.values[:, column.column - 1]
    if len(values) > MOST_LINES:
        raise ValueError(f"{path}: map.{name} has {len(values)} samples, at most {MOST_LINES}; leave out some")
    if len(wrong := np.flatnonzero(~(np.isfinite(values) | (gaps & np.isnan(values))))):
        remedy = "write NaN where a sample is missing" if gaps else "leave out these samples of all channels"
        raise ValueError(f"{path}: map.{name} has no finite number at {len(wrong)} of {len(values)} samples, the first "
                         f"at index {wrong[0]}; {remedy}")  # fmt: skip
    return column.sign * values, text


def mapping_of(path: Path, instrument: str | None) -> dict[str, Column]:
    """Return the mapping of an entry [[objective]] of a case or of another TOML file.

    Parameters
    ----------
    path : Path
    instrument : str or None
        Its instrument; None is that of the only entry with a mapping.

    Raises
    ------
    ValueError
        No entry has a mapping, or several have one.
    """
    entries = [each for each in load_toml_file(path).get("objective", []) if each.get("map")]
    fitting = [each for each in entries if instrument in (None, each.get("instrument"))]
    if len(fitting) != 1:
        names = ", ".join(str(each.get("instrument")) for each in entries) or "none"
        raise ValueError(f"{path}: {len(fitting)} entries [[objective]] with a map fit, of {names}; choose one with "
                         "--instrument, or add one as ruptfx data prints it")  # fmt: skip
    return {str(name): Column.model_validate(each) for name, each in fitting[0]["map"].items()}


def as_csv(path: Path, columns: Mapping[str, Column], out: Path) -> None:
    """Write the mapped times and channels of a file as a CSV file with units in its header.

    Raises
    ------
    ValueError
    """
    times, data, units = mapped(path, columns)
    header = ", ".join(["time (s)", *(f"{name} ({units[name]})" for name in data)])
    np.savetxt(out, np.column_stack([times, *data.values()]), fmt="%.17g", delimiter=", ", header=header, comments="",
               encoding="utf-8")  # fmt: skip


def events_of(folder: Path) -> list[Path]:
    """Return the data files of a folder with one file per event, those of the most frequent ending, by name.

    Raises
    ------
    ValueError
        There is none.
    """
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in (*TEXT, *BINARY) and path.is_file())
    if not files:
        raise ValueError(f"{folder}: has no data files; they end with one of {', '.join((*TEXT, *BINARY))}")
    endings = [path.suffix.lower() for path in files]
    most = max(sorted(set(endings)), key=endings.count)
    return [path for path in files if path.suffix.lower() == most]
