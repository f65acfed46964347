"""Displacements of the surface, as image correlation gives them, against data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from ruptfx.input import number_files
from ruptfx.input.netcdf_units import opened, unit_and_factor, unpacked
from ruptfx.input.quantities import factor
from ruptfx.input.schema import CaseError, Unit
from ruptfx.input.units import Duration, Length
from ruptfx.readings.instruments import Channel
from ruptfx.readings.misfits import Floats, Measured, Misfit, Request, Sample, Trace

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings

MOST = 20_000
MOST_READ = 20_000_000  # values of a variable of a file, of which `every` takes some
Lengths = Annotated[list[float], Unit("m")]


class DisplacementField(Misfit):
    """Displacements of points at one time: half the sum of ((reading - data) / sigma)^2 over points and components.

    Data are those of `ruptfx dic --pixel` (NetCDF with `displacement_x`, `displacement_y` and their coordinates), or
    of a CSV file with the columns `x (mm), y (mm), displacement_x (um), displacement_y (um)`, of which one displacement
    is enough. Lost points, which are NaN in NetCDF files, do not count. Neighbouring subsets share pixels, and their
    errors are not independent: choose `every` as the side of a subset, in pixels. A case contains the data, not the
    file.
    """

    example: ClassVar[str] = (
        '{ kind = "displacement_field", time = 3e-6, sigma = 1e-6, x = [4e-3, 5e-3, 7e-3], y = [1e-3, -1e-3, 2e-3], '
        "displacement_x = [1e-6, -1e-6, 0.0], displacement_y = [0.0, 0.0, 0.0] }"
    )

    time: Duration
    """Time of the second picture; the first one shows the initial state."""
    file: str | None = None
    """NetCDF file of `ruptfx dic`, or CSV file, relative to the case file."""
    origin: Annotated[list[float], Field(min_length=2, max_length=2), Unit("m")] = [0.0, 0.0]
    """Position in the case of the origin of the coordinates of the data."""
    every: Annotated[int, Field(ge=1)] = 1
    """Of a NetCDF file every n-th row and column count."""
    x: Lengths = []
    """Coordinates of the points, in place of a file."""
    y: Lengths = []
    """Coordinates of the points."""
    displacement_x: Lengths = []
    """Displacements of the points along x."""
    displacement_y: Lengths = []
    """Displacements of the points along y."""
    body: str | None = None
    """Body of the points; default is that in which each of them is."""
    sigma: Length
    """Standard deviation of a displacement."""

    @model_validator(mode="before")
    @classmethod
    def _read(cls, values: object, info: ValidationInfo) -> object:
        if not isinstance(values, Mapping) or not isinstance(values.get("file"), str):
            return values
        if values.get("x") or values.get("displacement_x") or values.get("displacement_y"):
            raise ValueError("give either a file, or x, y and displacements")
        every = values.get("every", 1)
        if not isinstance(every, int) or every < 1:
            return {k: v for k, v in values.items() if k != "file"}  # refused with its key
        path = Path((info.context or {}).get("directory") or ".", values["file"])
        read = _from_grid if path.suffix == ".nc" else _from_text
        return {**{k: v for k, v in values.items() if k not in ("file", "every")}, **read(path, every)}

    @model_validator(mode="after")
    def _complete(self) -> DisplacementField:
        if not self.x or not (self.displacement_x or self.displacement_y):
            raise ValueError("there are no data; give a file, or x, y and displacements")
        for name, values in (("y", self.y), *((f"displacement_{axis}", each) for axis, each in self._given.items())):
            if len(values) != len(self.x):
                raise ValueError(f"{name}: {len(values)} values at {len(self.x)} points; give one for each")
        if len(self.x) > MOST:
            raise ValueError(f"{len(self.x)} points: more than {MOST}; leave out points")
        return self

    @property
    def _given(self) -> dict[str, list[float]]:
        both = {"x": self.displacement_x, "y": self.displacement_y}
        return {axis: values for axis, values in both.items() if values}

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        case = bodies.model.case
        if self.time > case.duration * (1 + 1e-9):
            raise CaseError(f"{key}.time = {self.time:g} s: the run lasts {case.duration:g} s; make it longer")
        if not {"x", "y"} <= set(bodies.axes) or len(bodies.axes) > 2:
            raise CaseError(f"{key}.kind = 'displacement_field': pictures show x and y; plane = '{case.plane}' has "
                            "other displacements, use an instrument and 'traces'")  # fmt: skip
        times = np.array([self.time])
        points = [
            bodies.point([self.origin[0] + x, self.origin[1] + y], self.body, f"{key}.x.{number}")
            for number, (x, y) in enumerate(zip(self.x, self.y, strict=True))
        ]
        return [
            Trace(
                Channel(f"displacement_{axis}", "m", f"displacement along {axis}",
                        [point.motion("displacement", bodies.unit_vector(bodies.axes[axis]))]), times,
            ) for axis in self._given for point in points
        ]  # fmt: skip

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        pairs = self.residuals(samples)
        return sum(0.5 * float(r @ r) for r, _ in pairs), [r * factor for r, factor in pairs]

    def residuals(self, samples: Sequence[Sample]) -> list[tuple[Floats, Floats]]:
        return [
            ((sample.values - wanted.values) / self.sigma, np.full(1, 1 / self.sigma))
            for wanted, sample in zip(self.measured(), samples, strict=True)
        ]

    def measured(self) -> list[Measured]:
        time = np.array([self.time])
        return [
            Measured(f"displacement_{axis} at ({x:g}, {y:g}) m", time, np.array([value]))
            for axis, values in self._given.items() for x, y, value in zip(self.x, self.y, values, strict=True)
        ]  # fmt: skip


def _from_text(path: Path, every: int) -> dict[str, list[float]]:
    columns = number_files.with_units(path, "m", "m")
    wanted = ("x", "y", "displacement_x", "displacement_y")
    if not {"x", "y"} < columns.keys() or not columns.keys() <= set(wanted):
        raise ValueError(f"{path}: columns {', '.join(columns)}; needed are x, y, displacement_x, displacement_y")
    return {name: (np.array(column) * float(factor(unit, "m"))).tolist() for name, (column, unit) in columns.items()}


def _from_grid(path: Path, every: int) -> dict[str, list[float]]:
    with opened(path) as file:
        names = [f"displacement_{axis}" for axis in "xy" if f"displacement_{axis}" in file.variables]
        if not names or not {"x", "y"} <= set(file.variables):
            raise ValueError(f"{path}: needs displacement_x and displacement_y with x and y; see `ruptfx dic`")
        read = {}
        for name in ("x", "y", *names):
            unit = str(file[name].attrs.get("units", ""))
            if unit in ("", "pixel"):
                raise ValueError(f"{path}: '{name}' is in pixels or has no unit; use `ruptfx dic --pixel`")
            axes, wanted = file[name].dimensions, {name} if name in ("x", "y") else {"x", "y"}
            if set(axes) != wanted:
                value, asked = ", ".join(axes) or "none", " and ".join(sorted(wanted))
                raise ValueError(f"{path}: '{name}' has the axes {value}; give it {asked}")
            values = unpacked(path, file[name], MOST_READ) * unit_and_factor(path, name, file[name].attrs, "m")[1]
            read[name] = values.T if axes == ("x", "y") else values
            if name not in ("x", "y") and read[name].shape != (len(read["y"]), len(read["x"])):
                raise ValueError(f"{path}: '{name}' has other numbers of values than x and y; run `ruptfx dic` again")
    if not (np.isfinite(read["x"]).all() and np.isfinite(read["y"]).all()):
        raise ValueError(f"{path}: x or y has missing values; run `ruptfx dic` again")
    known = np.all([np.isfinite(read[name]) for name in names], axis=0)
    if (points := int(known[::every, ::every].sum())) > MOST:
        least = next(n for n in count(every) if known[::n, ::n].sum() <= MOST)
        raise ValueError(f"every = {every}: {points} points of {path}, at most {MOST} are read; give every = {least}")
    known = known[::every, ::every]
    fields = {name: read[name][::every, ::every] for name in names}
    x, y = np.meshgrid(read["x"][::every], read["y"][::every])
    return {"x": x[known].tolist(), "y": y[known].tolist(),
            **{name: each[known].tolist() for name, each in fields.items()}}  # fmt: skip
