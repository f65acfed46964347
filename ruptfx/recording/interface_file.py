"""The history of one interface: `interface.h5`, NetCDF4 that xarray opens with names, coordinates and units."""

from __future__ import annotations

import time
from pathlib import Path

import h5netcdf
import h5py
import numpy as np

from ruptfx import Table
from ruptfx.fault import Fault
from ruptfx.fields import DERIVED, FIELDS, MONITORS, OF_SLIDING

FLUSH_EVERY = 5.0  # seconds of wall-clock time a record may wait in memory
BLOCK = 50  # records written at once; one by one, HDF5 would cost more than the mechanics


class InterfaceFile:
    """Histories of all fields of a fault against time and position; rank 0 only.

    Parameters
    ----------
    path : Path
    fault : Fault
    place : ndarray, shape (points, 1 + dim)
        Position along the interface and coordinates [m].
    attributes : dict
        Global attributes of the file.
    """

    def __init__(self, path: Path, fault: Fault, place: np.ndarray, attributes: Table) -> None:
        self.path = path
        self._waiting: list[tuple[float, dict[str, np.ndarray]]] = []
        self._flushed = time.monotonic()
        resumed = path.exists()
        self._open("a" if resumed else "w")
        if resumed:
            return
        file = self._file
        file.dimensions = {"time": None, "position": len(place)}
        names = ("position", "x", "y", "z")
        for key, values in zip(names, place.T, strict=False):
            text = f"position along the interface: {fault.interface.line.meaning}" if key == "position" else key
            _variable(file, key, ("position",), "m", text, values)
        _variable(file, "time", ("time",), "s", "time")
        for field in (*FIELDS, *DERIVED, *(OF_SLIDING if fault.slides else ())):
            for name in field.names(fault.tangents) if field.recorded else ():
                _variable(file, name, ("time", "position"), field.unit, field.long_name, meanings=field.meanings)
        for name, unit in fault.friction.all_state_fields().items():
            _variable(file, name, ("time", "position"), unit, f"state variable {name}")
        for monitor in MONITORS:
            _variable(file, monitor.name, ("position",), monitor.unit, monitor.long_name)
        file.attrs.update(attributes)
        self._flush_to_disk()

    def _open(self, mode: str) -> None:
        self._disk = h5py.File(self.path, mode)
        self._file = h5netcdf.File(self._disk, mode)

    def _flush_to_disk(self) -> None:
        # h5netcdf's own flush stops short of the disk: a killed run would leave a file that cannot be opened.
        self._file.flush()
        self._disk.flush()

    def append(self, now: float, fields: dict[str, np.ndarray]) -> None:
        """Add one record: the time [s] and every field, shape (points,)."""
        self._waiting.append((now, fields))
        if len(self._waiting) >= BLOCK or time.monotonic() - self._flushed > FLUSH_EVERY:
            self.flush()

    def flush(self) -> None:
        """Write what waits in memory."""
        if self._waiting:
            file = self._file
            begin = file.dimensions["time"].size
            file.resize_dimension("time", begin + len(self._waiting))
            file["time"][begin:] = [now for now, _ in self._waiting]
            for name in self._waiting[0][1].keys() & file.variables.keys():
                if file[name].dimensions == ("position",):
                    file[name][:] = self._waiting[-1][1][name]
                else:
                    file[name][begin:] = np.stack([fields[name] for _, fields in self._waiting])
            self._waiting = []
        self._flush_to_disk()
        self._flushed = time.monotonic()

    def settle(self) -> None:
        """Close and open again: only a closed HDF5 file may be copied."""
        self.close()
        self._open("a")

    def complete(self) -> None:
        """Say that the run came to its end."""
        self._file.attrs["complete"] = 1

    def close(self) -> None:
        """Write the rest."""
        try:
            self.flush()
            self._file.close()
        finally:
            self._disk.close()


def _variable(
    file: h5netcdf.File, name: str, dimensions: tuple[str, ...], unit: str, text: str,
    values: np.ndarray | None = None, meanings: tuple[str, ...] = (),
) -> None:
    """A quantity, or a state of a few meanings as the CF conventions have them."""
    missing = np.nan if values is None and not meanings else None
    variable = file.create_variable(name, dimensions, np.int8 if meanings else np.float64, fillvalue=missing)
    if meanings:
        variable.attrs["flag_values"] = np.arange(len(meanings), dtype=np.int8)
        variable.attrs["flag_meanings"] = " ".join(meanings)
    variable.attrs["units"] = unit
    variable.attrs["long_name"] = text
    if values is not None:
        variable[:] = values
