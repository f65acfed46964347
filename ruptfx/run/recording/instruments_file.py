"""Measurements of instruments: `instruments.h5`, NetCDF4 with a group for every instrument."""

from __future__ import annotations

import json
from pathlib import Path

import h5netcdf
import numpy as np

from ruptfx import Table
from ruptfx.readings.instruments import Channel, Instrument
from ruptfx.run.recording.growing_file import GrowingFile

BLOCK = 1000  # samples of an instrument written at once
MOST = 1_000_000  # numbers that wait in memory


class InstrumentsFile(GrowingFile):
    """File with the samples of every instrument against its own time; rank 0 only.

    Parameters
    ----------
    path : Path
        Path of the file; an existing file is continued.
    instruments : list of (Instrument, list of Channel)
    attributes : dict
        Global attributes of the file.
    """

    def __init__(self, path: Path, instruments: list[tuple[Instrument, list[Channel]]], attributes: Table) -> None:
        super().__init__(path)
        self._names = {
            instrument.name: list(dict.fromkeys(channel.name for channel in value)) for instrument, value in instruments
        }
        self._grids = {instrument.name: instrument.grid is not None for instrument, _ in instruments}
        self._waiting: dict[str, list[tuple[np.ndarray, list[np.ndarray]]]] = {name: [] for name in self._names}
        if self.resumed:
            return
        self._file.attrs.update(attributes)
        for instrument, channels in instruments:
            group = self._file.create_group(instrument.name)
            grid = instrument.grid
            group.dimensions = {"time": None, **({} if grid is None else {"point": len(grid)})}
            group.attrs["kind"] = instrument.kind()
            group.attrs["instrument"] = json.dumps(instrument.model_dump(mode="json"))
            _variable(group, "time", "s", "time of all numbers of a sample")
            for axis, column in zip("xyz", () if grid is None else grid.T, strict=False):
                coordinate = group.create_variable(axis, ("point",), np.float64, data=column)
                coordinate.attrs["units"], coordinate.attrs["long_name"] = "m", f"coordinate {axis} of the points"
            for channel in {each.name: each for each in channels}.values():
                _variable(group, channel.name, channel.unit, channel.long_name, 0 if grid is None else len(grid))
        self.flush()

    def append(self, samples: list[tuple[str, np.ndarray, list[np.ndarray]]]) -> None:
        """Add samples of some instruments: name, times [s], values by channel."""
        for name, times, values in samples:
            self._waiting[name].append((times, values))
        longest = max(sum(len(times) for times, _ in rows) for rows in self._waiting.values())
        numbers = sum(len(times) * len(values) for rows in self._waiting.values() for times, values in rows)
        self.flush_if(longest >= BLOCK or numbers >= MOST)

    def write(self) -> None:
        for name, blocks in self._waiting.items():
            if not blocks:
                continue
            group = self._file[name]
            begin = group.dimensions["time"].size
            times = np.concatenate([times for times, _ in blocks])
            group.resize_dimension("time", begin + len(times))
            group["time"][begin:] = times
            for number, channel in enumerate(self._names[name]):
                if self._grids[name]:
                    points = group.dimensions["point"].size
                    of_points = slice(number * points, (number + 1) * points)
                    rows = [np.stack(values[of_points], axis=1) for _, values in blocks]
                else:
                    rows = [values[number] for _, values in blocks]
                group[channel][begin:] = np.concatenate(rows)
            self._waiting[name] = []


def _variable(group: h5netcdf.Group, name: str, unit: str, text: str, points: int = 0) -> None:
    """Create the variable of a channel, of a grid if it has points."""
    dimensions, chunks = (("time", "point"), (1, points)) if points else (("time",), (BLOCK,))
    variable = group.create_variable(name, dimensions, np.float64, fillvalue=np.nan, chunks=chunks)
    variable.attrs["units"] = unit
    variable.attrs["long_name"] = text
