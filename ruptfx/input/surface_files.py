"""Values on a grid of a surface, from CSV, NetCDF and GeoTIFF files."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.map_frame import EAST, NORTH
from ruptfx.input.netcdf_units import read_grid
from ruptfx.input.number_files import NumberTable, read_table
from ruptfx.platform.files import require_file

MOST_BYTES = 200_000_000  # of a height map
MOST_VALUES = 1_000_000  # the resolved case contains them
GEOTIFF = (".tif", ".tiff")
STRIKE, DIP = ("strike", *EAST), ("dip", *NORTH)
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
    variable, frame = grid.get("variable"), grid.get("map")
    projection = frame.get("projection") if isinstance(frame, Mapping) else getattr(frame, "projection", None)
    if path.suffix.lower() in NETCDF:
        csv = of_netcdf(path, variable if isinstance(variable, str) else None, unit, projection is not None)
    elif variable is not None:
        raise ValueError(f"variable = {variable!r}: only NetCDF files ({', '.join(NETCDF)}) have variables; remove it")
    elif path.suffix.lower() in GEOTIFF:
        csv = of_geotiff(path, projection is not None)
    else:
        csv = of_csv(path, unit, projection is not None)
    return {**{name: value for name, value in grid.items() if name not in ("file", "variable")}, **csv._asdict()}


def of_csv(path: Path, unit: str | None, in_degrees: bool = False) -> SurfaceGrid:
    """Read a CSV file with the columns strike, dip and value, one line for each point of a grid, in any order.

    Lines before the first number and lines that begin with # are skipped, except for the units of the header. The
    first columns may also be x and y, or longitude and latitude, `in_degrees` whatever their header.

    Raises
    ------
    ValueError
    """
    table = read_table(path)
    if table.width != 3:
        raise ValueError(f"line {table.lines[0]} of {path}: {table.width} columns; give three, strike, dip and value")
    for line, cells in table.headers:
        for column, (cell, names) in enumerate(zip(cells, (DIP, STRIKE), strict=False), 1):
            if _is_one_of(names, cell):
                raise ValueError(
                    f"line {line} of {path}: column {column} is {cell.strip()}; write strike, dip, value, or x, y, "
                    "value, in this order"
                )
    scales = {0: None, 1: None} | table.factors({2: unit} if in_degrees else {0: "m", 1: "m", 2: unit})
    rows = np.array([table.column(i, scale or 1) for i, scale in scales.items()]).T
    return _gridded(rows, table.lines, path, _axes(table, in_degrees))


def _is_one_of(names: tuple[str, ...], cell: str) -> bool:
    return re.match(rf"({'|'.join(names)})\b", cell.strip().lower()) is not None


def _axes(table: NumberTable, in_degrees: bool) -> tuple[str, str, str]:
    """Return the names of both positions as the header has them, and their unit."""
    for _, cells in reversed(table.headers):
        if len(cells) > 1 and _is_one_of(STRIKE, cells[0]) and _is_one_of(DIP, cells[1]):
            first, second = (re.split(r"\W", cell.strip(), maxsplit=1)[0] for cell in cells[:2])
            return first, second, "degrees" if in_degrees else "m"
    return ("longitude", "latitude", "degrees") if in_degrees else ("strike", "dip", "m")


def _gridded(rows: np.ndarray, lines: list[int], path: Path, axes: tuple[str, str, str]) -> SurfaceGrid:
    """Return the grid of points in any order.

    Parameters
    ----------
    axes : tuple of str
        Names of both positions and their unit, for messages.

    Raises
    ------
    ValueError
        A point is missing or given twice.
    """
    (strike, i), (dip, k) = (np.unique(rows[:, column], return_inverse=True) for column in (0, 1))
    first, second, unit = axes
    if len(strike) < 2 or len(dip) < 2:
        raise ValueError(
            f"{path}: at least two positions of {first} and two of {second} are needed, found {len(strike)} and "
            f"{len(dip)}; give a line for each point of a grid"
        )
    count = np.zeros((len(dip), len(strike)), dtype=int)
    np.add.at(count, (k, i), 1)
    if count.max() > 1:
        seen: set[tuple[int, int]] = set()
        for line, place in zip(lines, zip(k.tolist(), i.tolist(), strict=True), strict=True):
            if place in seen:
                raise ValueError(
                    f"line {line} of {path}: the point {first} = {strike[place[1]]:.9g} {unit}, {second} = "
                    f"{dip[place[0]]:.9g} {unit} is given twice; remove one of them"
                )
            seen.add(place)
    if count.min() == 0:
        row, column = np.argwhere(count == 0)[0]
        raise ValueError(
            f"{path}: no value at {first} = {strike[column]:.9g} {unit}, {second} = {dip[row]:.9g} {unit}; a grid "
            f"needs one at all {len(strike)} x {len(dip)} combinations of its positions"
        )
    values = np.empty(count.shape)
    values[k, i] = rows[:, 2]
    return SurfaceGrid(strike.tolist(), dip.tolist(), values.tolist())


def of_netcdf(path: Path, variable: str | None, unit: str | None, in_degrees: bool = False) -> SurfaceGrid:
    """Read a variable of a NetCDF file with the coordinates strike and dip, in the units of their attributes `units`.

    The coordinates may also be called x and y, easting and northing, or longitude and latitude (lon and lat).

    Parameters
    ----------
    variable : str or None
        Its name; None if the file has one only.
    unit : str or None
        Unit of the values, also if they have no attribute; coordinates without one are in m.
    in_degrees : bool
        Coordinates have no unit of length.

    Raises
    ------
    ValueError
    """
    grid = read_grid(path, variable, (*DIP, *STRIKE), unit, MOST_VALUES, None if in_degrees else "m")
    if len(grid.names) != 2 or grid.names[0] not in DIP or grid.names[1] not in STRIKE:
        raise ValueError(
            f"{path}: the values have the axes {', '.join(grid.names)}; give them two, strike and dip, x and y, or "
            "longitude and latitude, with coordinates"
        )
    dip, strike = grid.coordinates
    return SurfaceGrid(strike.tolist(), dip.tolist(), grid.values.tolist())


def of_geotiff(path: Path, in_degrees: bool = False) -> SurfaceGrid:
    """Read heights [m] from an image with one band, whose tags place its pixels along east and north.

    Raises
    ------
    ValueError
        No such tags, several bands, missing values, or coordinates in degrees without a projection.
    """
    from PIL import Image

    require_file(path, MOST_BYTES, remedy="give a GeoTIFF file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged tags, whose values are checked below
            with Image.open(path, formats=["TIFF"]) as image:
                tags = {number: image.tag_v2.get(number) for number in (33550, 33922, 34735, 42113)}  # type: ignore[attr-defined]
                if (count := image.width * image.height) > MOST_VALUES:
                    raise ValueError(
                        f"{path}: has {count} pixels, and height maps at most {MOST_VALUES}; make it coarser"
                    )
                values = np.asarray(image, dtype=float)
    except Exception as error:  # Pillow raises many kinds of errors for damaged files
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: cannot be read as TIFF ({error!s:.200}); save it again, or as NetCDF") from None
    scale, tie = tags[33550], tags[33922]
    if values.ndim != 2 or scale is None or tie is None or len(tie) != 6 or min(values.shape) < 2:
        raise ValueError(
            f"{path}: is no map of one band with ModelPixelScale and one ModelTiepoint, the place of its pixels; save "
            "it as GeoTIFF with one band that is not rotated, or as NetCDF"
        )
    keys = dict(zip((tags[34735] or ())[4::4], (tags[34735] or ())[7::4], strict=False))
    if (keys.get(1024) == 2) != in_degrees:
        raise ValueError(
            f"{path}: its coordinates are {'longitudes and latitudes' if keys.get(1024) == 2 else 'lengths'}; "
            + (
                "leave out projection in map"
                if in_degrees
                else "give map = { origin = [...], projection = 'EPSG:...' }"
            )
        )
    missing = ~np.isfinite(values)
    if tags[42113]:
        with suppress(ValueError):  # no number: no pixel has this value
            missing |= values == float(str(tags[42113]).strip("\0 "))
    if missing.any():
        raise ValueError(f"{path}: {missing.sum()} pixels have no value; fill them")
    middle = 0.0 if keys.get(1025) == 2 else 0.5  # pixels are points, or areas
    strike = tie[3] + (np.arange(values.shape[1]) + middle - tie[0]) * scale[0]
    dip = tie[4] - (np.arange(values.shape[0]) + middle - tie[1]) * scale[1]
    return SurfaceGrid(strike.tolist(), dip[::-1].tolist(), values[::-1].tolist())
