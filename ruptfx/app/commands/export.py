"""`ruptfx export`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ruptfx.app.commands._shared import Overwrite, begin, reported, runs, screen, writing

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np

    from ruptfx.results.record import Record

HEADING = "Post-process"


class Format(StrEnum):  # older Typers know no Literal
    """File formats of other programs."""

    csv = "csv"
    netcdf = "netcdf"
    vtk = "vtk"
    vtkhdf = "vtkhdf"
    scec = "scec"
    seas = "seas"


def export(
    run: Annotated[Path, typer.Argument(help="Run directory.", autocompletion=runs, show_default=False)],
    format_: Annotated[Format, typer.Option("--format", help="csv, netcdf, vtk, vtkhdf, scec or seas.")] = Format.csv,
    out: Annotated[Path | None, typer.Option(help="Folder; default RUN/export.")] = None,
    overwrite: Overwrite = False,
    station: Annotated[
        list[str] | None,
        typer.Option(help="Of seas: '7.5 km' down dip; on a surface '-24 km, 10 km'. Default those of the benchmarks."),
    ] = None,
    off_fault: Annotated[
        list[str] | None,
        typer.Option(
            help="Of seas, motion off the fault: 'benchmark', or '8 km' from it at the surface; on a surface "
            "'-16 km, 8 km, 0 km' along strike, off the fault and deep. Builds the bodies again."
        ),
    ] = None,
) -> None:
    """Write a run for other programs.

    csv: interfaces as tables. netcdf: interfaces and bodies. vtk: a VTU file for each snapshot of the bodies. vtkhdf:
    bodies and interfaces with all their times, for ParaView. scec: receivers and rupture times of faults in 3D,
    as the SCEC/USGS code comparison reads them. seas: time series of stations, profiles and global.dat of cycles
    with rate and state friction, as the SEAS code comparison reads them; every file is read back and checked.

    Example: ruptfx export runs/impact --format vtkhdf
    """
    begin(f"reading {run}")
    with reported():
        from ruptfx import RuptfxError
        from ruptfx.app.convert import scec_files, seas_files, vtk_files
        from ruptfx.results.record import Record

        def scec(record: Record, folder: Path) -> Iterator[Path]:
            return scec_files.files(record, folder, lambda line: screen.print(line, soft_wrap=True))

        def seas(record: Record, folder: Path) -> Iterator[Path]:
            return seas_files.files(record, folder, lambda line: screen.print(line, soft_wrap=True), stations, ground)

        stations = seas_files.parse_stations(station or ())
        ground = seas_files.parse_off_fault(off_fault)
        for option, value in (("station", station), ("off-fault", off_fault)):
            if value and format_ is not Format.seas:
                raise RuptfxError(
                    f"export --{option} is for --format seas, not {format_.value}; remove it or use this format"
                )
        folder = out or run / "export"
        with Record(run) as record, writing(folder, overwrite=overwrite) as files:
            write = {
                Format.csv: tables, Format.netcdf: datasets, Format.vtk: vtk_files.series,
                Format.vtkhdf: vtk_files.whole, Format.scec: scec, Format.seas: seas,
            }  # fmt: skip
            names = [files.claim(path.name).name for path in write[format_](record, files.place)]
        for name in names:
            screen.print(str(folder / name), soft_wrap=True)


def tables(record: Record, folder: Path) -> Iterator[Path]:
    """Write a table of each field of each interface: a row per time, a column per position.

    Fields without time are columns of one table. Yield the paths.
    """
    import numpy as np

    for name, data in record.interfaces.items():
        position, along = data.position.values, data.position.dims  # of a surface its points
        still = {str(key): field for key, field in data.data_vars.items()
                 if field.dims == along and key != "position"}  # fmt: skip
        units = [f"{key} [{field.attrs.get('units', '1')}]" for key, field in still.items()]
        rows = np.column_stack([position, *(field.values for field in still.values())])
        yield _save(folder / f"{name}.csv", ",".join(["position [m]", *units]), rows)
        for key, field in data.data_vars.items():
            if field.dims == ("time", *along):
                header = f"{key} [{field.attrs.get('units', '1')}]: time [s] below, position [m] to the right\ntime,"
                header += ",".join(f"{value:.9g}" for value in position)
                rows = np.column_stack([data.time.values, field.values])
                yield _save(folder / f"{name}_{key}.csv", header, rows)


def _save(path: Path, header: str, rows: np.ndarray) -> Path:
    import numpy as np

    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header)
    return path


def datasets(record: Record, folder: Path) -> Iterator[Path]:
    """Write one NetCDF file per interface and one for the bodies; yield the paths."""
    from ruptfx.results.hdf5 import write_netcdf

    for name, data in record.interfaces.items():
        write_netcdf(data, folder / f"{name}.nc")
        yield folder / f"{name}.nc"
    if (record.path / "bulk.h5").exists():
        write_netcdf(record.bulk, folder / "bulk.nc")
        yield folder / "bulk.nc"
