"""Slip from a table over time and place."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from ruptfx.input.netcdf_units import opened, unit_and_factor, unpacked
from ruptfx.input.number_files import read_table
from ruptfx.input.schema import CaseError, CasePath
from ruptfx.input.surface_files import NETCDF
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.slip_histories._samples import Sampled, Samples
from ruptfx.platform.files import read_once

NEEDED = {"time": "s", "position": "m"}
OTHERS = {"dip": "m", "slip": "m", "slip_1": "m", "slip_2": "m"}


class Table(Sampled):
    """Slip from a CSV or NetCDF file over time and place.

    Columns, or variables, are `time`, `position`, on a surface `dip`, and `slip` or, with two components, `slip_1`
    (along strike) and `slip_2` (down dip); headers and attributes `units` give units. A CSV file has a line for each
    time and point, in any order. In a NetCDF file slip has the dimensions of time and of the points; `interface.h5` of
    a run is such a file: with a record in every step and the same mesh and steps the tractions are those of that run.
    Between times monotone cubics interpolate; slip begins and ends at rest. Beyond the points nothing is prescribed.
    Source: Fritsch and Carlson (1980).
    """

    source: ClassVar[str] = "Fritsch and Carlson (1980)"
    example: ClassVar[str] = '{ kind = "table", file = "slip.csv" }'
    files_of_example: ClassVar[dict[str, str]] = {
        "slip.csv": "time (us), position (mm), slip (um)\n"
        + "".join(f"{t}, {x}, {0.1 * t * t * x * (4 - x)}\n" for t in (0, 1, 2, 3) for x in (0, 1, 2, 3, 4))
    }

    file: CasePath
    """CSV or NetCDF file, relative to the case file."""

    def samples(self, face: Interface) -> Samples:
        return _read(self.file)


@read_once
def _read(file: str) -> Samples:
    path = Path(file)
    try:
        return of_netcdf(path) if path.suffix.lower() in NETCDF else _of_csv(path)
    except ValueError as error:
        raise CaseError(str(error)) from None


def _components(path: Path, names: set[str]) -> list[str]:
    """Return the names of the components of slip.

    Raises
    ------
    ValueError
    """
    missing = [name for name in NEEDED if name not in names]
    shear: list[str] = [name for name in ("slip", "slip_1", "slip_2") if name in names]
    if missing or shear not in (["slip"], ["slip_1", "slip_2"]):
        shown = ", ".join(sorted(names)) or "none of them"
        raise ValueError(
            f"{path}: needs time, position and slip, on a surface also dip, and slip or both slip_1 and slip_2; "
            f"it has {shown}"
        )
    return shear


def _of_csv(path: Path) -> Samples:
    table = read_table(path, is_named=True)
    columns = table.named(NEEDED | OTHERS)
    shear = _components(path, set(columns))
    if not table.rows:
        raise ValueError(f"{path}: has no line with numbers; give one for each time and point")
    values = {name: np.array(table.column(*columns[name])) for name in columns}
    times, row = np.unique(values["time"], return_inverse=True)
    axes = [name for name in ("position", "dip") if name in columns]
    places, column = np.unique(np.stack([values[name] for name in axes], axis=1), axis=0, return_inverse=True)
    count = np.zeros((len(times), len(places)), dtype=int)
    np.add.at(count, (row, column.ravel()), 1)
    if not np.all(count == 1):
        at = np.argwhere(count != 1)[0]
        point = ", ".join(f"{axis} = {x:.6g} m" for axis, x in zip(axes, places[at[1]], strict=True))
        raise ValueError(
            f"{path}: {count[tuple(at)]} lines for time {times[at[0]]:.6g} s and {point}; every one of "
            f"{len(times)} times needs "
            f"one line for each of {len(places)} points"
        )
    slip = np.zeros((*count.shape, len(shear)))
    for k, name in enumerate(shear):
        slip[row, column.ravel(), k] = values[name]
    return _checked(path, times, places, slip)


def of_netcdf(path: Path) -> Samples:
    """Return the samples of a NetCDF file, such as `interface.h5` of a run.

    Raises
    ------
    ValueError
        It cannot be read, or lacks something.
    """
    with opened(path) as file:
        names = set(file.variables)
        shear = _components(path, names & {*NEEDED, *OTHERS})
        units = NEEDED | {name: OTHERS[name] for name in (*shear, "dip") if name in names}
        values = {}
        for name, unit in units.items():
            variable = file.variables[name]
            values[name] = unpacked(path, variable) * unit_and_factor(path, name, variable.attrs, unit)[1]
            if not np.isfinite(values[name]).all():
                raise ValueError(f"{path}: '{name}' has values that are missing or not finite; fill them")
    axes = [values[name] for name in ("position", "dip") if name in values]
    shape = (len(np.atleast_1d(values["time"])), len(np.atleast_1d(axes[0])))
    if any(np.shape(axis) != shape[1:] for axis in axes) or any(np.shape(values[name]) != shape for name in shear):
        raise ValueError(
            f"{path}: slip has the shape {np.shape(values[shear[0]])}; it needs {shape}, that of the times and "
            "the points"
        )
    return _checked(path, values["time"], np.stack(axes, axis=1), np.stack([values[name] for name in shear], axis=2))


def _checked(path: Path, times: np.ndarray, places: np.ndarray, slip: np.ndarray) -> Samples:
    if len(times) < 2 or np.any(np.diff(times) <= 0):
        raise ValueError(f"{path}: has {len(times)} times; give two or more, increasing")
    if len(np.unique(places, axis=0)) != len(places):
        raise ValueError(f"{path}: has points that coincide; leave out one of them")
    return Samples(str(path), times, places[:, 0] if places.shape[1] == 1 else places, slip)
