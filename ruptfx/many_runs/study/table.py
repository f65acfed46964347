"""Table of all scalars of a study over its axes: ``table.csv`` and, for a grid, a labelled data set."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray

from ruptfx import Table
from ruptfx.many_runs.study.definition import Point, Study
from ruptfx.many_runs.study.store import Result
from ruptfx.results import summary_fields

Row = Table
TIMINGS = ("wall_time", "node_updates_per_second", "seconds", "run_time")
"""Columns that differ between two runs of the same point."""


def rows(study: Study, known: Sequence[tuple[Point, Result]], fine: Mapping[str, Result]) -> list[Row]:
    """Return one row per point: coordinates, status, quantities, error, hash."""
    every = dict.fromkeys(name for _, result in known for name in result.get("values", {}))
    columns = [axis.column for axis in study.axes]  # an axis takes precedence over a scalar of the same name
    names = study.quantities or [name for name in every if name not in ("title", "case_hash", *columns)]
    table = []
    for point, result in known:
        values = result.get("values", {})
        row = {**point.coordinates, "origin": point.origin, "status": result["status"]}
        row |= {name: values.get(name) for name in names}
        if fine:
            row["fine_mesh"] = fine.get(point.hash, {}).get("values", {}).get(study.refine.by)
        error = " ".join(str(result.get("error", "")).split())
        table.append({**row, "seconds": result.get("seconds"), "error": error, "point": point.hash})
    return table


def write_csv(path: Path, table: Sequence[Row]) -> None:
    """Write the table; empty cells are quantities that do not exist."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]) if table else ["point"])
        writer.writeheader()
        writer.writerows({k: repr(v) if isinstance(v, float) else v for k, v in row.items()} for row in table)


def read_csv(path: str | Path) -> list[Row]:
    """Read rows with numbers as floats and empty cells as None."""
    with Path(path).open(newline="") as file:
        return [{key: _parsed(value) for key, value in row.items()} for row in csv.DictReader(file)]


def dataset(study: Study, table: Sequence[Row]) -> xarray.Dataset:
    """Return quantities over the axes of a grid; over `point` for a hypercube, with the axes as coordinates.

    Refined points are in the table only.
    """
    table = [row for row in table if row["origin"] == "sample"]
    columns = [axis.column for axis in study.axes]
    quantities = [name for name in (table[0] if table else {}) if name not in (*columns, "origin")]
    attrs = {axis.column: _attributes(axis.label, axis.unit) for axis in study.axes}
    if study.sampled:
        data = xarray.Dataset(coords={c: ("point", _array([row[c] for row in table]), attrs[c]) for c in columns})
        for name in quantities:
            data[f"{name}_hash" if name == "point" else name] = ("point", _array([row[name] for row in table]))
    else:
        values = {a.column: [a.coordinate(v) for v in a.sequence()] for a in study.axes}
        data = xarray.Dataset(coords={c: (c, _array(v), attrs[c]) for c, v in values.items()})
        shape = [len(v) for v in values.values()]
        for name in quantities:
            data[name] = (columns, _array([row[name] for row in table]).reshape(shape))
    plane = study.plane
    for key in data.data_vars:
        name = str(key)
        data[name].attrs["units"] = unit_of(name, plane)
    data.attrs = {"title": study.title, "sampling": study.sampling}
    return data


def unit_of(name: str, plane: str) -> str:
    """Return the unit of a column of a study of cases in this plane."""
    return summary_fields.unit(name, plane) or "1"


def write_dataset(path: Path, data: xarray.Dataset) -> None:
    """Write a data set as NetCDF."""
    from ruptfx.results.hdf5 import write_netcdf

    write_netcdf(data, path)


def _attributes(label: str, unit: str) -> dict[str, str]:
    return {"units": unit, **({"long_name": label} if label else {})}


def _array(values: Sequence[float | str | None]) -> np.ndarray:
    """Return floats with NaN for missing values; text if any value is text."""
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else str(value) for value in values], dtype=object)
    return np.array([math.nan if value is None else float(value) for value in values])


def _parsed(text: str) -> object:
    if text == "":
        return None
    try:
        return float(text)
    except ValueError:
        return text
