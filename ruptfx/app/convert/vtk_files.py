"""A run as VTK data: vectors and tensors, body of every cell, initial state, interfaces as lines or surfaces.

Two formats: a VTU file for each snapshot, which meshio reads as well, and VTKHDF, one file with all times for ParaView
5.12 or newer, VTK and PyVista.

Source: VTK file formats, https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

from ruptfx import RuptfxError
from ruptfx.results.analysis.ground_motion import speeds_of
from ruptfx.results.analysis.raster import body_of_cells
from ruptfx.results.analysis.surface import grid, is_surface
from ruptfx.results.hdf5 import new_hdf5

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Record

LINE, TRIANGLE, QUADRILATERAL, TETRAHEDRON, HEXAHEDRON, VERTEX = 3, 5, 9, 10, 12, 1
# VTK number and meshio name of the cell type, by number of dimensions and corners.
CELLS = {
    (2, 3): (TRIANGLE, "triangle"), (2, 4): (QUADRILATERAL, "quad"), (3, 4): (TETRAHEDRON, "tetra"),
    (3, 8): (HEXAHEDRON, "hexahedron"),
}  # fmt: skip
TENSOR = ("xx", "yy", "zz", "xy", "yz", "xz")  # a symmetric one, in the order of VTK
Snapshot = dict[str, np.ndarray]


def series(record: Record, folder: Path) -> Iterator[Path]:
    """Write one VTU file for each snapshot of the bodies, and a PVD file with their times; yield the paths.

    Raises
    ------
    RuptfxError
        meshio is not installed.
    """
    try:
        import meshio
    except ModuleNotFoundError:
        raise RuptfxError("export --format vtk: meshio is not installed; install it with: pip install meshio") from None
    points, cells, kind, body = _mesh(record.bulk)
    lines = []
    for number, (time, values) in enumerate(_snapshots(record.bulk)):
        path = folder / f"bulk_{number:04d}.vtu"
        meshio.Mesh(points, [(CELLS[kind][1], cells)], values, {"body": [body]}).write(path)
        lines.append(f'<DataSet timestep="{time!r}" file="{path.name}"/>')
        yield path
    path = folder / "bulk.pvd"
    text = "\n".join(lines)
    path.write_text(f'<VTKFile type="Collection" version="0.1">\n<Collection>\n{text}\n</Collection>\n</VTKFile>\n')
    yield path


def whole(record: Record, folder: Path) -> Iterator[Path]:
    """Write a VTKHDF file for the bodies, for each interface and for each grid of receivers, with all times.

    Yield the paths.
    """
    if (record.path / "bulk.h5").is_file():
        points, cells, kind, body = _mesh(record.bulk)
        path = folder / "bulk.vtkhdf"
        _write(path, points, cells, CELLS[kind][0], {"body": body}, _snapshots(record.bulk))
        yield path
    for name, data in record.interfaces.items():
        path = folder / f"{name}.vtkhdf"
        along = np.stack([data[axis].values for axis in ("x", "y", "z") if axis in data], axis=1)
        cells, kind_of_cell = _interface_cells(data)
        of_points = data["position"].dims  # of a surface its points
        still = {str(key): field.values for key, field in data.data_vars.items() if field.dims == of_points}
        moments = ((float(time), {**_moving(data, number), **still}) for number, time in enumerate(data["time"].values))
        _write(path, _three(along), cells, kind_of_cell, {}, moments)
        yield path

    for table in record.case.get("instruments", []):
        if table["kind"] == "receiver_grid":
            path = folder / f"{table['name']}_grid.vtkhdf"
            _write_grid(path, record.instruments[table["name"]])
            yield path


def _write_grid(path: Path, data: xarray.Dataset) -> None:
    """Write a grid of receivers: vectors and tensors at its points, and the largest speed of every point."""
    places = np.stack([data[axis].values for axis in ("x", "y", "z") if axis in data], axis=1)
    names: dict[str, list[str]] = {}
    for key in data.data_vars:
        if data[key].dims == ("time", "point"):
            quantity, _, component = str(key).rpartition("_")
            names.setdefault(quantity, []).append(component)
    still = {} if "velocity" not in names else {"peak_speed": speeds_of(data).max(axis=0)}

    def moments() -> Iterator[tuple[float, Snapshot]]:
        for number, time in enumerate(data["time"].values):
            fields = dict(still)
            for quantity, components in names.items():
                columns = [data[f"{quantity}_{each}"].isel(time=number).values for each in components]
                filled = _tensor if quantity in ("stress", "strain") else _three
                order = ["".join(sorted(each)) for each in components] if filled is _tensor else components
                fields[quantity] = filled(np.stack(columns, axis=1), order)
            yield float(time), fields

    cells, kind = _grid_cells(places)
    _write(path, _three(places), cells, kind, {}, moments())


def _grid_cells(places: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the cells of a grid along the axes, whose last coordinate varies fastest, and their VTK number."""
    shape = [len(np.unique(column)) for column in places.T]
    number = np.arange(len(places)).reshape([count for count in shape if count > 1] or [1])
    if number.ndim == 1:
        line = number if len(number) == 1 else np.column_stack([number[:-1], number[1:]])
        return (line[:, None], VERTEX) if len(number) == 1 else (line, LINE)
    low, high = slice(None, -1), slice(1, None)
    square = [(low, low), (high, low), (high, high), (low, high)]
    if number.ndim == 2:
        return np.stack([number[corner].ravel() for corner in square], axis=1), QUADRILATERAL
    corners = [(*corner, level) for level in (low, high) for corner in square]
    return np.stack([number[corner].ravel() for corner in corners], axis=1), HEXAHEDRON


def _interface_cells(data: xarray.Dataset) -> tuple[np.ndarray, int]:
    """Return the cells of an interface and their VTK number.

    They are lines in 2D, quadrilaterals of a surface whose points form a grid, and else single points.
    """
    count = data["position"].size
    if not is_surface(data):  # points are in order along the interface
        return np.column_stack([np.arange(count - 1), np.arange(1, count)]), LINE
    positions = grid(data)
    if positions is None:
        return np.arange(count)[:, None], VERTEX
    number = np.arange(count).reshape([len(each) for each in positions])
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    return np.stack([each.ravel() for each in corners], axis=1), QUADRILATERAL


def _mesh(bulk: xarray.Dataset) -> tuple[np.ndarray, np.ndarray, tuple[int, int], np.ndarray]:
    """Return points in three dimensions [m], cells, their kind, and the body of each."""
    points, cells = bulk["points"].values, bulk["cells"].values.astype(np.int64)
    return _three(points), cells, (points.shape[1], cells.shape[1]), body_of_cells(bulk)


def _snapshots(bulk: xarray.Dataset) -> Iterator[tuple[float, Snapshot]]:
    """Yield time [s] and fields of the initial state, if its stress is in the file, and of all saved times."""
    first = bulk.attrs.get("initial_stress_values")
    if first is not None and bulk.sizes["time"]:
        shapes = {name: values.shape for name, values in _moving(bulk, 0).items()}
        zeros = {name: np.zeros(shape) for name, shape in shapes.items()}
        stress = np.broadcast_to(np.atleast_1d(first), (bulk.sizes["point"], np.size(first)))
        if "stress" in zeros:
            zeros["stress"] = _tensor(stress, list(bulk["stress_component"].values))
        if "fringe" in zeros:
            from ruptfx.results.analysis.photoelasticity import difference_of

            zeros["fringe"] = difference_of(stress)
        yield 0.0, zeros
    for number, time in enumerate(bulk["time"].values):
        yield float(time), _moving(bulk, number)


def _moving(data: xarray.Dataset, number: int) -> Snapshot:
    """Return fields at one time: vectors of three components, tensors of six."""
    entries = {}
    for key, field in data.data_vars.items():
        if field.dims[:1] != ("time",) or field.ndim < 2:
            continue
        values = field.isel(time=number).values
        if "component" in field.dims:
            values = _three(values, list(data["component"].values))
        elif "stress_component" in field.dims:
            values = _tensor(values, list(data["stress_component"].values))
        entries[str(key)] = values
    return entries


def _three(values: np.ndarray, names: list[str] | None = None) -> np.ndarray:
    """Return vectors with x, y and z; missing components are zero."""
    filled = np.zeros((len(values), 3))
    filled[:, ["xyz".index(name) for name in names] if names else range(values.shape[1])] = values
    return filled


def _tensor(values: np.ndarray, names: list[str]) -> np.ndarray:
    """Return symmetric tensors; components that were not saved are NaN, because they are not zero."""
    filled = np.full((len(values), 6), np.nan)
    filled[:, [TENSOR.index(name) for name in names]] = values
    return filled


def _write(
    path: Path, points: np.ndarray, cells: np.ndarray, kind: int, of_cells: Snapshot,
    moments: Iterator[tuple[float, Snapshot]],
) -> None:  # fmt: skip
    """Write an unstructured grid that does not change, with fields at its points that do."""
    with new_hdf5(path) as (file, check):
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        name = b"UnstructuredGrid"
        root.attrs.create("Type", name, dtype=h5py.string_dtype("ascii", len(name)))
        for key, number in (("Points", len(points)), ("Cells", len(cells)), ("ConnectivityIds", cells.size)):
            root[f"NumberOf{key}"] = np.array([number])
        root["Points"] = points
        root["Connectivity"] = cells.ravel()
        root["Offsets"] = np.arange(0, cells.size + 1, cells.shape[1])
        root["Types"] = np.full(len(cells), kind, dtype=np.uint8)
        for key, values in of_cells.items():
            root[f"CellData/{key}"] = values
        fields, times = root.create_group("PointData"), []
        for time, moment in moments:
            times.append(time)
            for key, rows in moment.items():
                if key not in fields:
                    limits = (None, *rows.shape[1:])
                    chunk = (max(len(rows), 1), *rows.shape[1:])
                    fields.create_dataset(key, (0, *rows.shape[1:]), rows.dtype, maxshape=limits, chunks=chunk)
                fields[key].resize(len(times) * len(points), axis=0)
                fields[key][-len(points) :] = rows
            check()
        _write_steps(root, np.array(times), len(points), list(fields), list(of_cells))


def _write_steps(root: h5py.Group, times: np.ndarray, points: int, fields: list[str], of_cells: list[str]) -> None:
    """Write which rows of the data sets belong to which time [s]."""
    count = len(times)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = count
    steps["Values"] = times
    steps["NumberOfParts"] = np.ones(count, dtype=np.int64)
    steps["PartOffsets"] = steps["PointOffsets"] = np.zeros(count, dtype=np.int64)
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = np.zeros((count, 1), dtype=np.int64)
    for key in fields:
        steps[f"PointDataOffsets/{key}"] = points * np.arange(count)
    for key in of_cells:
        steps[f"CellDataOffsets/{key}"] = np.zeros(count, dtype=np.int64)
