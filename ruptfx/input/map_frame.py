"""Coordinates of maps: eastings and northings, or longitudes and latitudes, of points of a model."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from ruptfx.input.schema import CaseError, Part, Unit

EAST = ("x", "easting", "lon", "longitude")
NORTH = ("y", "northing", "lat", "latitude")
"""Names of the coordinates in files, in lower case."""


class MapFrame(Part):
    """Place of the model on a map: its origin, the direction of its x axis, and the projection of the map.

    Without `projection` the coordinates of the file are eastings and northings [m], as of a UTM zone; with it they are
    longitudes and latitudes of WGS 84 in degrees, which the package pyproj projects.
    """

    origin: Annotated[list[float], Field(min_length=2, max_length=2), Unit("1")]
    """Coordinates of the point x = 0, y = 0 of the model in the file: easting and northing in metres, or longitude and
    latitude in degrees."""
    azimuth: Annotated[float, Field(ge=0, lt=360), Unit("1")] = 90.0
    """Direction of the x axis in degrees from north over east; y is to the left of it."""
    projection: str | None = None
    """Projected coordinate system in metres by its name, such as `EPSG:32611`, zone 11 north of UTM."""

    @model_validator(mode="after")
    def _on_the_globe(self) -> MapFrame:
        if self.projection is not None:
            longitude, latitude = self.origin
            if not (-180 <= longitude <= 360 and -90 < latitude < 90):
                raise ValueError(
                    f"origin = {self.origin}: with projection these are longitude (-180 to 360) and latitude (-90 to "
                    "90) in degrees; write them in this order, or leave out projection"
                )
        return self

    @property
    def axes(self) -> tuple[str, str]:
        """Names of the coordinates of the file."""
        return ("easting", "northing") if self.projection is None else ("longitude", "latitude")

    @cached_property
    def _projected(self) -> Any:
        """Transformer from longitude and latitude to the projection."""
        try:
            import pyproj
        except ImportError as error:
            raise CaseError(
                f"projection = '{self.projection}' needs pyproj ({error}): pip install 'ruptfx[geo]'"
            ) from None
        try:
            system = pyproj.CRS.from_user_input(self.projection)
        except pyproj.exceptions.CRSError as error:
            raise CaseError(
                f"projection = '{self.projection}': is no coordinate system ({error!s:.80}); give a name "
                "such as EPSG:32611"
            ) from None
        if not system.is_projected or any(axis.unit_name != "metre" for axis in system.axis_info):
            raise CaseError(
                f"projection = '{self.projection}': {system.name} is no projection in metres; give "
                "one, such as EPSG:32611"
            )
        return pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)

    @cached_property
    def _turned(self) -> np.ndarray:
        """Unit vectors of x and y of the model along east and north, as rows."""
        angle = np.deg2rad(self.azimuth)
        east, north = np.sin(angle), np.cos(angle)
        return np.round([[east, north], [-north, east]], 15)

    def _eastings(self, places: np.ndarray) -> np.ndarray:
        """Return eastings and northings [m] of points of the file, shape (n, 2)."""
        return places if self.projection is None else np.stack(self._projected.transform(*places.T), axis=1)

    def to_model(self, places: np.ndarray) -> np.ndarray:
        """Return x and y [m] of points with coordinates of the file, shape (n, 2).

        Raises
        ------
        CaseError
            An unknown projection, or points outside of its range.
        """
        relative = self._eastings(places) - self._eastings(np.array([self.origin]))
        if not np.isfinite(relative).all():
            bad = places[np.argmin(np.isfinite(relative).all(axis=1))]
            raise CaseError(
                f"({bad[0]:.8g}, {bad[1]:.8g}): the projection {self.projection} has no such longitude and latitude; "
                "correct the order of both, or choose another projection"
            )
        return np.asarray(relative @ self._turned.T)

    def to_map(self, places: np.ndarray) -> np.ndarray:
        """Return the coordinates of the file of points with x and y [m], shape (n, 2)."""
        eastings = places @ self._turned + self._eastings(np.array([self.origin]))
        if self.projection is None:
            return np.asarray(eastings)
        return np.stack(self._projected.transform(*eastings.T, direction="INVERSE"), axis=1)
