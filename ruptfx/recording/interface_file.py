"""The history of one interface: `interface.h5`, NetCDF4 with names, coordinates and units for xarray."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import h5netcdf
import numpy as np

from ruptfx import Table
from ruptfx.faults.fault import Fault
from ruptfx.fields import MONITORS, Field
from ruptfx.recording.growing_file import GrowingFile

BLOCK = 50  # records written at once; one by one, HDF5 would cost more than the mechanics


class InterfaceFile(GrowingFile):
    """Histories of all fields of a fault against time and position; rank 0 only.

    Parameters
    ----------
    path : Path
    fault : Fault
    place : ndarray, shape (points, 1 + dim)
        Position along the interface and coordinates [m].
    attributes : dict
        Global attributes of the file.
    kept : int or None
        Number of records to keep in an existing file; later ones are removed.
    fields : iterable of Field
        Fields of its points besides the state of the friction law.
    """

    def __init__(
        self, path: Path, fault: Fault, place: np.ndarray, attributes: Table, kept: int | None,
        fields: Iterable[Field],
    ) -> None:  # fmt: skip
        super().__init__(path)
        self._waiting: list[tuple[float, dict[str, np.ndarray]]] = []
        if self.resumed:
            self._file.attrs["complete"] = 0
            if kept is not None:
                self._file.resize_dimension("time", kept)
            return
        file = self._file
        file.dimensions = {"time": None, "position": len(place)}
        names = ("position", "x", "y", "z")
        for key, values in zip(names, place.T, strict=False):
            text = f"position along the interface: {fault.interface.line.meaning}" if key == "position" else key
            _variable(file, key, ("position",), "m", text, values)
        _variable(file, "time", ("time",), "s", "time")
        for field in fields:
            for name in field.names(fault.tangents) if field.recorded else ():
                _variable(file, name, ("time", "position"), field.unit, field.long_name, meanings=field.meanings)
        for name, unit in fault.state_fields().items():
            _variable(file, name, ("time", "position"), unit, f"state variable {name}")
        for monitor in MONITORS:
            _variable(file, monitor.name, ("position",), monitor.unit, monitor.long_name)
        file.attrs.update(attributes)
        self.flush()

    def append(self, now: float, fields: dict[str, np.ndarray]) -> None:
        """Append one record: the time [s] and every field, shape (points,)."""
        self._waiting.append((now, fields))
        self.flush_if(len(self._waiting) >= BLOCK)

    def write(self) -> None:
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

    def complete(self) -> None:
        """Mark the run as complete."""
        self._file.attrs["complete"] = 1


def _variable(
    file: h5netcdf.File, name: str, dimensions: tuple[str, ...], unit: str, text: str,
    values: np.ndarray | None = None, meanings: tuple[str, ...] = (),
) -> None:
    """Return the variable of a quantity, or of a state with a few meanings as in the CF conventions."""
    missing = np.nan if values is None and not meanings else None
    variable = file.create_variable(name, dimensions, np.int8 if meanings else np.float64, fillvalue=missing)
    if meanings:
        variable.attrs["flag_values"] = np.arange(len(meanings), dtype=np.int8)
        variable.attrs["flag_meanings"] = " ".join(meanings)
    variable.attrs["units"] = unit
    variable.attrs["long_name"] = text
    if values is not None:
        variable[:] = values
