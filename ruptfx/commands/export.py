"""`ruptfx export`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ruptfx.record import Record


class Format(StrEnum):  # older Typers know no Literal
    """What other programs read."""

    csv = "csv"
    netcdf = "netcdf"
    vtk = "vtk"


def export(
    run: Annotated[Path, typer.Argument(help="Run directory.", show_default=False)],
    format_: Annotated[Format, typer.Option("--format", help="csv, netcdf or vtk.")] = Format.csv,
    out: Annotated[Path | None, typer.Option(help="Folder; default RUN/export.")] = None,
) -> None:
    """Write a run for other programs: interfaces as tables (csv), all as NetCDF, or snapshots of the bodies as VTU."""
    with reported():
        from ruptfx.record import Record

        folder = out or run / "export"
        with Record(run) as record:
            folder.mkdir(parents=True, exist_ok=True)
            write = {Format.csv: tables, Format.netcdf: datasets, Format.vtk: snapshots}[format_]
            for path in write(record, folder):
                screen.print(str(path), soft_wrap=True)


def tables(record: Record, folder: Path) -> Iterator[Path]:
    """A table of each field of each interface: a row for every time, a column for every position.

    Fields without time are columns of one table.
    """
    for name, data in record.interfaces.items():
        position = data.position.values
        still = {str(key): field for key, field in data.data_vars.items() if field.dims == ("position",)}
        units = [f"{key} [{field.attrs.get('units', '1')}]" for key, field in still.items()]
        rows = np.column_stack([position, *(field.values for field in still.values())])
        yield _save(folder / f"{name}.csv", ",".join(["position [m]", *units]), rows)
        for key, field in data.data_vars.items():
            if field.dims == ("time", "position"):
                header = f"{key} [{field.attrs.get('units', '1')}]: time [s] below, position [m] to the right\ntime,"
                header += ",".join(f"{value:.9g}" for value in position)
                rows = np.column_stack([data.time.values, field.values])
                yield _save(folder / f"{name}_{key}.csv", header, rows)


def _save(path: Path, header: str, rows: np.ndarray) -> Path:
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header)
    return path


def datasets(record: Record, folder: Path) -> Iterator[Path]:
    """One NetCDF file for each interface, one for the bodies."""
    for name, data in record.interfaces.items():
        data.to_netcdf(folder / f"{name}.nc", engine="h5netcdf", invalid_netcdf=False)
        yield folder / f"{name}.nc"
    if (record.path / "bulk.h5").exists():
        record.bulk.to_netcdf(folder / "bulk.nc", engine="h5netcdf", invalid_netcdf=False)
        yield folder / "bulk.nc"


def snapshots(record: Record, folder: Path) -> Iterator[Path]:
    """One VTU file for each snapshot, with vectors of three components, and a PVD file that names their times.

    Raises
    ------
    RuptfxError
        meshio is not installed.
    """
    try:
        import meshio
    except ModuleNotFoundError:
        raise RuptfxError("export --format vtk: meshio is not installed; install it with: pip install meshio") from None
    bulk = record.bulk
    points, cells = bulk.points.values, bulk.cells.values
    kind = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}[points.shape[1], cells.shape[1]]
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    lines = []
    for number, time in enumerate(bulk.time.values):
        found = {str(name): field.isel(time=number) for name, field in bulk.data_vars.items() if "time" in field.dims}
        values = {name: _vectors(field.values, "component" in field.dims) for name, field in found.items()}
        path = folder / f"bulk_{number:04d}.vtu"
        meshio.Mesh(points, [(kind, cells)], {**values, "body": bulk.body.values}).write(path)
        lines.append(f'<DataSet timestep="{float(time)!r}" file="{path.name}"/>')
        yield path
    path = folder / "bulk.pvd"
    text = "\n".join(lines)
    path.write_text(f'<VTKFile type="Collection" version="0.1">\n<Collection>\n{text}\n</Collection>\n</VTKFile>\n')
    yield path


def _vectors(values: np.ndarray, vector: bool) -> np.ndarray:
    """Vectors with three components, as VTK knows them; the one of antiplane is z."""
    if not vector or values.shape[1] == 3:
        return values
    before = 2 if values.shape[1] == 1 else 0
    return np.pad(values, ((0, 0), (before, 3 - before - values.shape[1])))
