"""Motion, strain and stress at the points of a grid: maps of ground motion, slices, parts of outer surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.boundaries import check_vector
from ruptfx.input.schema import CaseError, Unit
from ruptfx.input.units import Length
from ruptfx.laws.materials import Plane
from ruptfx.readings.instruments import Channel, Instrument
from ruptfx.readings.instruments.receiver import Quantity, channels_of

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings

MOST = 100_000  # points
Corner = Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]


class ReceiverGrid(Instrument):
    """Velocity, displacement, strain and stress at the points of a grid along the axes.

    Its points fill the rectangle, the line or the block between two corners: the surface of the Earth, a slice through
    the bodies, a part of an outer side. `instruments.h5` has arrays (time, point) and the coordinates of the points,
    `ruptfx export RUN --format vtkhdf` writes the grid with all its times for ParaView, and the figure `ground_motion`
    shows the largest speed of every point. Points where bodies meet are those of the first body of the mesh.
    """

    example: ClassVar[str] = (
        '{ kind = "receiver_grid", name = "grid", interval = 2e-7, corner = [1e-3, 1e-3], opposite = [9e-3, 3e-3], '
        "spacing = 2e-3 }"
    )

    corner: Corner
    """One corner of the grid."""
    opposite: Corner
    """The corner opposite to it."""
    spacing: Length
    """Distance between points along every axis; a little larger or smaller where the sides are no multiple of it."""
    body: str | None = None
    """Name of the body of points where bodies meet."""
    fields: Annotated[list[Quantity], Field(min_length=1)] = ["velocity"]
    """Recorded quantities."""

    @model_validator(mode="after")
    def _affordable(self) -> ReceiverGrid:
        count = float(np.prod([float(number) for number in self.shape]))
        if count > MOST:
            raise ValueError(
                f"spacing = {self.spacing:g} m: {count:.3g} points from corner to opposite, at most {MOST}; make it "
                "larger"
            )
        return self

    def check(self, key: str, plane: Plane, components: str) -> None:
        for name in ("corner", "opposite"):
            check_vector(f"{key}.{name}", getattr(self, name), "xyz" if plane == "solid" else "xy")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points along each axis."""
        extent = np.abs(np.subtract(self.opposite[: len(self.corner)], self.corner[: len(self.opposite)]))
        return tuple(round(side / self.spacing) + 1 if side > 0 else 1 for side in extent)

    @property
    def grid(self) -> np.ndarray:
        axes = [np.linspace(first, last, count) for first, last, count in
                zip(self.corner, self.opposite, self.shape, strict=True)]  # fmt: skip
        return np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")], axis=1)

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        of_points = list(self._of_points(readings, key))
        return [channel for by_name in zip(*of_points, strict=True) for channel in by_name]

    def _of_points(self, readings: ModelReadings, key: str) -> Iterator[list[Channel]]:
        """Yield the channels of every point; collective."""
        for point in self.grid.tolist():
            try:
                place = readings.point(point, self.body, key, "corner", first=True)
            except CaseError as error:
                shown = ", ".join(f"{value:.6g}" for value in point)
                raise CaseError(
                    f"{key}.corner = {self.corner}, opposite = {self.opposite}: the point ({shown}) m of the "
                    f"grid cannot be measured; move the corners ({error})"
                ) from None
            yield channels_of(readings, place, self.fields)
