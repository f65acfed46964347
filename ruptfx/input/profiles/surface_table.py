"""Interpolation over a grid of a surface."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo, field_validator, model_validator

from ruptfx.input.map_frame import MapFrame
from ruptfx.input.profiles import Profile, Value
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError, Unit
from ruptfx.input.surface_files import with_grid_read


class SurfaceTable(Profile):
    """Interpolation of values on a grid of strike and dip, which covers the surface.

    Of the surface of the ground, as `mesh.topography`, and of surfaces of `rough_plates` and `block_on_rigid` the
    positions are x and y.
    """

    over_surface: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "surface_table", strike = [-1.0, 0.0, 2.0], dip = [-1.0, 1.0], '
        "values = [[0.0, 1.0, 3.0], [2.0, 2.0, 4.0]] }"
    )
    interpolation: Literal["linear", "cubic"] = "linear"
    """`cubic`: splines along both directions whose curvature is continuous, for measured surfaces."""
    strike: list[Annotated[float, Unit("m")]] = []
    """Positions along strike, or x, at least two, increasing; in degrees if `map` has a projection."""
    dip: list[Annotated[float, Unit("m")]] = []
    """Positions down dip, or y, at least two, increasing; in degrees if `map` has a projection."""
    values: list[list[Value]] = []
    """A row for each position down dip, with a value for each along strike."""
    file: str | None = None
    """CSV, NetCDF or GeoTIFF file instead of the lists, relative to the case file. A CSV file has the columns strike,
    dip and value, or x, y and value, and a line for each point of the grid; its header may give the units, as in
    `strike (km), dip (km), stress (MPa)`. A NetCDF file (.nc, .nc4, .h5, .cdf, .netcdf) has a variable with the
    coordinates `strike` and `dip`, `x` and `y`, or `lon` and `lat`, all with attributes `units`. A GeoTIFF file (.tif,
    .tiff) has one band of heights in m. Default are m and the unit of the key. The resolved case contains the
    numbers."""
    variable: str | None = None
    """Name of the variable of a NetCDF file that has several."""
    map: MapFrame | None = None
    """Place of the model on the map, if the positions are eastings and northings, or longitudes and latitudes."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        return with_grid_read(values, info, unit)

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, values: object, info: ValidationInfo) -> object:
        """Read the file of a table created in Python, without a key."""
        return with_grid_read(values, info, None)

    @field_validator("strike", "dip")
    @classmethod
    def _increasing(cls, positions: list[float]) -> list[float]:
        if len(positions) < 2 or np.any(np.diff(positions) <= 0):
            raise ValueError("positions must increase and be at least two")
        return positions

    @model_validator(mode="after")
    def _matching(self) -> SurfaceTable:
        if self.variable is not None:
            raise ValueError(f"variable = '{self.variable}': belongs to a file; give file, or remove it")
        if [len(row) for row in self.values] != [len(self.strike)] * len(self.dip):
            raise ValueError(f"values: give {len(self.dip)} rows (dip) of {len(self.strike)} numbers (strike)")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        cells, parts, inside = [], [], []
        unit = " degrees" if self.map and self.map.projection else " m"
        names = ("strike", "dip") if self.map is None else self.map.axes
        position = position if self.map is None else self.map.to_map(position)
        for name, values, grid in zip(names, position.T, (self.strike, self.dip), strict=True):
            slack = 1e-9 * (grid[-1] - grid[0])  # rounding of coordinates
            if len(values) and not grid[0] - slack <= values.min() <= values.max() <= grid[-1] + slack:
                raise CaseError(
                    f"the table has {name} from {grid[0]:.9g} to {grid[-1]:.9g}{unit}, and the surface has points from "
                    f"{at_most(values.min() + slack)} to {at_least(values.max() - slack)}{unit}; add to the table"
                    + (", or correct map" if self.map else ", whose strike and dip are x and y of height maps")
                )
            inside.append(np.clip(values, grid[0], grid[-1]))
            cell = np.clip(np.searchsorted(grid, inside[-1], side="right") - 1, 0, len(grid) - 2)
            cells.append(cell)
            parts.append((inside[-1] - np.take(grid, cell)) / np.take(np.diff(grid), cell))
        (i, k), (s, d), table = cells, parts, np.asarray(self.values)
        if self.interpolation == "cubic":
            return self._splines(*inside)
        upper = (1 - s) * table[k, i] + s * table[k, i + 1]
        lower = (1 - s) * table[k + 1, i] + s * table[k + 1, i + 1]
        return (1 - d) * upper + d * lower

    def _splines(self, strike: np.ndarray, dip: np.ndarray) -> np.ndarray:
        """Return the values of splines along strike and down dip, shape (n,)."""
        from scipy.interpolate import RectBivariateSpline  # imported late: ordinary runs do not need it

        degrees = [min(3, len(grid) - 1) for grid in (self.dip, self.strike)]
        spline = RectBivariateSpline(self.dip, self.strike, np.asarray(self.values), kx=degrees[0], ky=degrees[1])
        return np.asarray(spline.ev(dip, strike))
