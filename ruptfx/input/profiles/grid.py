"""Interpolation on a grid of the bodies, from a NetCDF file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input import netcdf_units
from ruptfx.input.profiles import Profile
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError, CasePath
from ruptfx.platform.files import read_once

AXES = ("x", "y", "z")
SLACK = 1e-6  # of the length of an axis: rounding of coordinates, which files often have in single precision


class Grid(Profile):
    """Linear interpolation of a variable of a NetCDF file with the coordinates x and y, in 3D x, y and z.

    The grid covers the body. Attributes `units` of the variable and its coordinates give their units, without them
    they are in the unit of the key and m. The axes may be in any order, and one that the file does not have is an axis
    along which nothing varies.
    """

    over_body: ClassVar[bool] = True
    file: CasePath
    """NetCDF file, relative to the case file."""
    variable: str
    """Name of the variable; its unit is that of its attribute `units`, or else of the key."""
    interpolation: Literal["linear", "nearest"] = "linear"
    """`nearest`: the value of the nearest point of the grid, for layers with sharp boundaries."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        file, variable = (values.get("file"), values.get("variable")) if isinstance(values, Mapping) else (None, None)
        if isinstance(file, str) and isinstance(variable, str):
            path = Path((info.context or {}).get("directory") or ".", file)
            if path.exists():  # a file that is missing is refused when the values are read, or by `resume`
                netcdf_units.check_grid(path, variable, AXES, unit)
        return values

    def __call__(self, position: np.ndarray) -> np.ndarray:
        from scipy.interpolate import RegularGridInterpolator

        names, axes, values = _read(self.file, self.variable)
        columns = []
        for name, grid in zip(names, axes, strict=True):
            number = "xyz".index(name)
            if number >= position.shape[1]:
                raise CaseError(
                    f"{self.file}: '{self.variable}' varies along {name}; remove this axis, as the bodies have x and y "
                    "only"
                )
            x, slack = position[:, number], SLACK * (grid[-1] - grid[0])
            if len(x) and not grid[0] - slack <= x.min() <= x.max() <= grid[-1] + slack:
                raise CaseError(
                    f"{self.file}: {name} from {grid[0]:.6g} to {grid[-1]:.6g} m does not cover the body, which has "
                    f"points from {at_most(x.min() + slack)} to {at_least(x.max() - slack)} m; extend the grid"
                )
            columns.append(np.clip(x, grid[0], grid[-1]))
        return np.asarray(RegularGridInterpolator(axes, values, method=self.interpolation)(np.stack(columns, axis=1)))


@read_once
def _read(file: str, variable: str) -> netcdf_units.Grid:
    try:
        return netcdf_units.read_grid(Path(file), variable, AXES, None)
    except ValueError as error:
        raise CaseError(str(error)) from None
