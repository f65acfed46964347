"""Interpolation on a grid of the bodies, from a NetCDF file."""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from ruptfx.input.profiles import Profile
from ruptfx.input.schema import CaseError, CasePath

SLACK = 1e-6  # of the length of an axis: rounding of coordinates, which files often have in single precision


class Grid(Profile):
    """Linear interpolation of a variable of a NetCDF file with the coordinates x and y, in 3D x, y and z.

    The grid covers the body. Coordinates and values are in SI units; the axes may be in any order, and one that the
    file does not have is an axis along which nothing varies.
    """

    over_body: ClassVar[bool] = True
    file: CasePath
    """NetCDF file, relative to the case file."""
    variable: str
    """Name of the variable, in the unit of the key."""
    interpolation: Literal["linear", "nearest"] = "linear"
    """`nearest`: the value of the nearest point of the grid, for layers with sharp boundaries."""

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
                    f"points from {x.min():.6g} to {x.max():.6g} m; extend the grid"
                )
            columns.append(np.clip(x, grid[0], grid[-1]))
        return np.asarray(RegularGridInterpolator(axes, values, method=self.interpolation)(np.stack(columns, axis=1)))


@lru_cache(maxsize=16)
def _read(file: str, variable: str) -> tuple[list[str], list[np.ndarray], np.ndarray]:
    """Return the names and coordinates of the axes, increasing, and the values."""
    import xarray

    try:
        with xarray.open_dataset(file) as data:
            if variable not in data.data_vars:
                known = ", ".join(map(str, data.data_vars))
                raise CaseError(f"{file}: no variable '{variable}'; it has: {known}")
            found = data[variable].load()
    except (OSError, ValueError) as error:
        raise CaseError(f"{file}: cannot be read as NetCDF ({error})") from None
    names = [str(name) for name in found.dims]
    if not names or any(name not in ("x", "y", "z") or name not in found.coords for name in names):
        raise CaseError(f"{file}: '{variable}' has the axes {', '.join(names)}; name them x, y, z with coordinates")
    found = found.sortby(names)
    axes = [np.asarray(found[name].values, dtype=float) for name in names]
    values = np.asarray(found.values, dtype=float)
    if any(len(axis) < 2 or np.any(np.diff(axis) <= 0) for axis in axes):
        raise CaseError(f"{file}: every axis needs two different coordinates at least")
    if not np.isfinite(values).all():
        raise CaseError(f"{file}: '{variable}' has values that are missing or not finite; fill them")
    return names, axes, values
