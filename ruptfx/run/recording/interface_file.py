"""The history of one interface: `interface.h5`, NetCDF4 with names, coordinates and units for xarray."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import h5netcdf
import numpy as np

from ruptfx import Table
from ruptfx.input.fields import ADDED_SHEAR, INTERFACE_FIELDS, MONITORS, PLACE, Field
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.run.recording.growing_file import GrowingFile

BLOCK = 50  # records written at once; one by one, HDF5 would cost more than the mechanics


class InterfaceFile(GrowingFile):
    """Histories of all fields of a fault against time and position; rank 0 only.

    Parameters
    ----------
    place : dict of ndarray, shape (points,)
        Positions, coordinates [m] and tributary area of the points, as in `PLACE`.
    attributes : dict
        Global attributes of the file.
    kept : int or None
        Number of records to keep in an existing file; later ones are removed.
    fields : iterable of Field
        Fields of its points besides the state of the friction law.
    """

    def __init__(
        self, path: Path, fault: Fault, place: dict[str, np.ndarray], attributes: Table, kept: int | None,
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
        # A coordinate of a dimension has distinct values; the points of a surface have two positions.
        axis = "point" if "dip" in place else "position"
        file.dimensions = {"time": None, axis: len(place["position"])}
        for key, values in place.items():
            unit, text = PLACE.get(key, ("m", key))
            if key == "position":
                text += f": {fault.interface.line.meaning}"
            _variable(file, key, (axis,), unit, text, values)
        _variable(file, "time", ("time",), "s", "time")
        for field in fields:
            for name in field.names(fault.tangents) if field.recorded else ():
                _variable(file, name, ("time", axis), field.unit, field.long_name, meanings=field.meanings)
        for name, unit in fault.state_fields().items():
            known = INTERFACE_FIELDS.get(name)
            text = f"state variable {name}" if known is None else known.long_name
            _variable(file, name, ("time", axis), unit, text)
        for field in (*MONITORS, *[ADDED_SHEAR] * fault.is_loaded):
            for name in field.names(fault.tangents):
                _variable(file, name, (axis,), field.unit, field.long_name)
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
                if "time" not in file[name].dimensions:
                    file[name][:] = self._waiting[-1][1][name]
                else:
                    file[name][begin:] = np.stack([fields[name] for _, fields in self._waiting])
            self._waiting = []

    def complete(self) -> None:
        """Mark the run as complete."""
        self._file.attrs["complete"] = 1


def _variable(
    file: h5netcdf.File,
    name: str,
    dimensions: tuple[str, ...],
    unit: str,
    text: str,
    values: np.ndarray | None = None,
    meanings: tuple[str, ...] = (),
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
