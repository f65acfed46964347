"""Instruments at one point, of which a file of stations makes many."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from ruptfx.input.map_frame import EAST, NORTH, MapFrame
from ruptfx.input.number_files import NumberTable, name_and_factor, number, read_table
from ruptfx.readings.instruments import Instrument

MOST = 10_000  # stations
COLUMNS = {
    "name": ("name", "station", "code", "id"),
    "x": EAST, "y": NORTH, "z": ("z", "elevation", "height"),
}  # fmt: skip
"""Names of the columns, in lower case and without unit."""


class Station(NamedTuple):
    """A station: its name as a part of a name in a case, its coordinates [m], and whether its height is known."""

    name: str
    point: list[float]
    has_height: bool


def read_stations(path: Path, frame: MapFrame | None, dim: int) -> list[Station]:
    """Return the stations of a text file.

    Parameters
    ----------
    frame : MapFrame or None
        Place of the model on the map on which the stations are.
    dim : int
        Number of coordinates of the model; the last one is the height, which may be missing.

    Raises
    ------
    ValueError
        A column that is missing, a number that is none, a name that is given twice, or too many stations.
    """
    table = read_table(path, is_named=True)
    places, factors = _columns(table, frame is not None and frame.projection is not None)
    axes = "xyz"[:dim]
    if missing := [name for name in ("name", *axes[:-1]) if name not in places]:
        raise ValueError(
            f"{path}: has no column {' or '.join(missing)}; the first line must name them, as name, {', '.join(axes)}; "
            f"it has: {', '.join(table.headers[-1][1] if table.headers else []) or 'none'}"
        )
    if frame is not None and dim == 2:
        raise ValueError(f"{path}: a map has two directions, and the model one; leave out map")
    if not table.rows:
        raise ValueError(f"{path}: has no stations; give a line for each below the names of the columns")
    if len(table.rows) > MOST:
        raise ValueError(f"{path}: has {len(table.rows)} stations, at most {MOST}; leave out some")
    known = [axis for axis in axes if axis in places]
    points = np.zeros((len(table.rows), dim))
    for row, (words, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        for axis in known:
            points[row, axes.index(axis)] = factors[axis] * number(words[places[axis]], path, line)
    if frame is not None:
        points[:, :2] = frame.to_model(points[:, :2])
    stations: dict[str, Station] = {}
    for words, line, point in zip(table.rows, table.lines, points.tolist(), strict=True):
        name = re.sub(r"\W+", "_", words[places["name"]].strip(), flags=re.A)
        if name in stations:
            raise ValueError(f"line {line} of {path}: a second station {name}; rename or leave out one of them")
        stations[name] = Station(name, point, axes[-1] in places)
    return list(stations.values())


def _columns(table: NumberTable, in_degrees: bool) -> tuple[dict[str, int], dict[str, float]]:
    """Return index and factor to m of the columns that the header names.

    Raises
    ------
    ValueError
        An unknown unit, or one of another kind.
    """
    line, header = table.headers[-1] if table.headers else (1, [])
    places, factors = dict[str, int](), dict[str, float]()
    for place, cell in enumerate(header):
        word = re.split(r"[\s(\[/]", cell.strip().lower(), maxsplit=1)[0]
        for column, names in COLUMNS.items():
            if word in names and column not in places:
                places[column] = place
                in_metres = column == "z" or (column != "name" and not in_degrees)
                try:
                    factors[column] = float((name_and_factor(cell, "m")[1] if in_metres else None) or 1)
                except ValueError as error:
                    raise ValueError(f"line {line} of {table.path}, column {cell.strip()!r}: {error}") from None
    return places, factors


class AtStations(Instrument):
    """Contract of an instrument at one point, of which a file of stations makes many."""

    stations: str | None = None
    """Text file with a station in each line, instead of `point`: every one becomes an instrument with `name`, _ and its
    own name. Columns are called name, x, y and z, or easting and northing, longitude and latitude, and elevation, with
    units as in `x (km)`; without a height the stations are on the surface."""
    map: MapFrame | None = None
    """Place of the model on the map, if the positions are eastings and northings, or longitudes and latitudes."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema, in which `stations` replaces what each of them has itself."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        entry = handler.resolve_ref_schema(schema)
        required = entry.get("required", [])
        own = [key for key in required if key in ("name", "point")]
        entry["required"] = [key for key in required if key not in own]
        entry["anyOf"] = [{"required": own}, {"required": ["stations"]}]
        return schema

    @model_validator(mode="after")
    def _of_a_case(self) -> Self:
        for name in ("stations", "map"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: belongs to a case, which reads the file; give point of one station")
        return self

    @classmethod
    def of_stations(cls, values: Mapping[str, Any], directory: Path, dim: int) -> list[dict[str, Any]]:
        """Return the tables of the instruments at the stations of a file.

        Parameters
        ----------
        values : mapping
            Table of the case, with `stations`.
        dim : int
            Number of coordinates.

        Raises
        ------
        ValueError
        """
        if values.get("point") is not None:
            raise ValueError(f"point = {values['point']}: is not possible with stations; leave out one of them")
        frame = values.get("map")
        if frame is not None and not isinstance(frame, MapFrame):
            frame = MapFrame.model_validate(frame)
        common = {key: value for key, value in values.items() if key not in ("stations", "map")}
        tables = []
        for station in read_stations(directory / str(values["stations"]), frame, dim):
            table = common | {"name": f"{values.get('name', 'station')}_{station.name}", "point": station.point}
            if not station.has_height:
                if "on_surface" not in cls.model_fields:
                    raise ValueError(f"{values['stations']}: a {cls.kind()} needs {'xyz'[:dim]}; add the last column")
                table["on_surface"] = True
            tables.append(table)
        return tables
