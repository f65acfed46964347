"""Values on a grid of a surface, from CSV and NetCDF files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.netcdf_units import read_grid
from ruptfx.input.number_files import read_table

MOST_VALUES = 1_000_000  # the resolved case contains them
NETCDF = (".nc", ".nc4", ".h5", ".cdf", ".netcdf")


class SurfaceGrid(NamedTuple):
    """Positions along strike and down dip [m], and a row of values for each position down dip."""

    strike: list[float]
    dip: list[float]
    values: list[list[float]]


def with_grid_read(grid: object, info: ValidationInfo, unit: str | None) -> object:
    """Replace `file` and `variable` in the table of a profile by the grid that the file contains.

    Parameters
    ----------
    grid : object
        Table of the profile; without `file` it is returned as it is.
    info : ValidationInfo
        Validation context with the directory of the case.
    unit : str or None
        Unit of the key that varies.

    Raises
    ------
    ValueError
    """
    if not isinstance(grid, Mapping) or not isinstance(grid.get("file"), str):
        return grid
    if any(grid.get(name) for name in SurfaceGrid._fields):
        raise ValueError("give either a file, or strike, dip and values")
    path = Path((info.context or {}).get("directory") or ".", grid["file"])
    variable = grid.get("variable")
    if path.suffix.lower() in NETCDF:
        csv = of_netcdf(path, variable if isinstance(variable, str) else None, unit)
    elif variable is not None:
        raise ValueError(f"variable = {variable!r}: only NetCDF files ({', '.join(NETCDF)}) have variables; remove it")
    else:
        csv = of_csv(path, unit)
    return {**{name: value for name, value in grid.items() if name not in ("file", "variable")}, **csv._asdict()}


def of_csv(path: Path, unit: str | None) -> SurfaceGrid:
    """Read a CSV file with the columns strike, dip and value, one line for each point of a grid, in any order.

    Lines before the first number and lines that begin with # are skipped, except for the units of the header.

    Raises
    ------
    ValueError
    """
    table = read_table(path)
    if table.width != 3:
        raise ValueError(f"line {table.lines[0]} of {path}: {table.width} columns; give three, strike, dip and value")
    for line, cells in table.headers:
        for column, (cell, name) in enumerate(zip(cells, ("dip", "strike"), strict=False), 1):
            if cell.lower().startswith(name):
                raise ValueError(
                    f"line {line} of {path}: column {column} is {name}; write strike, dip, value in this order"
                )
    scales = table.factors({0: "m", 1: "m", 2: unit})
    return _gridded(np.array([table.column(i, scale or 1) for i, scale in scales.items()]).T, table.lines, path)


def _gridded(rows: np.ndarray, lines: list[int], path: Path) -> SurfaceGrid:
    """Return the grid of points in any order.

    Raises
    ------
    ValueError
        A point is missing or given twice.
    """
    (strike, i), (dip, k) = (np.unique(rows[:, column], return_inverse=True) for column in (0, 1))
    if len(strike) < 2 or len(dip) < 2:
        raise ValueError(
            f"{path}: at least two positions along strike and two down dip are needed, found {len(strike)} and "
            f"{len(dip)}"
        )
    count = np.zeros((len(dip), len(strike)), dtype=int)
    np.add.at(count, (k, i), 1)
    if count.max() > 1:
        seen: set[tuple[int, int]] = set()
        for line, place in zip(lines, zip(k.tolist(), i.tolist(), strict=True), strict=True):
            if place in seen:
                raise ValueError(
                    f"line {line} of {path}: the point strike = {strike[place[1]]:g} m, dip = {dip[place[0]]:g} m is "
                    "given twice; remove one of them"
                )
            seen.add(place)
    if count.min() == 0:
        row, column = np.argwhere(count == 0)[0]
        raise ValueError(
            f"{path}: no value at strike = {strike[column]:g} m, dip = {dip[row]:g} m; a grid needs one at all "
            f"{len(strike)} x {len(dip)} combinations of its positions"
        )
    values = np.empty(count.shape)
    values[k, i] = rows[:, 2]
    return SurfaceGrid(strike.tolist(), dip.tolist(), values.tolist())


def of_netcdf(path: Path, variable: str | None, unit: str | None) -> SurfaceGrid:
    """Read a variable of a NetCDF file with the coordinates strike and dip, in the units of their attributes `units`.

    Parameters
    ----------
    variable : str or None
        Its name; None if the file has one only.
    unit : str or None
        Unit of the values, also if they have no attribute; coordinates without one are in m.

    Raises
    ------
    ValueError
    """
    grid = read_grid(path, variable, ("dip", "strike"), unit, MOST_VALUES, every=True)
    dip, strike = grid.coordinates
    return SurfaceGrid(strike.tolist(), dip.tolist(), grid.values.tolist())
