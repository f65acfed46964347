"""A strain gauge or a rosette of several."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import check_vector
from ruptfx.input.schema import Unit
from ruptfx.input.units import Length
from ruptfx.laws.materials import Plane
from ruptfx.readings.instruments import Channel, Instrument, Share

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings


Direction = Annotated[list[float], Field(min_length=3, max_length=3), Unit("1")]
STRAIGHT = 1e-6
"""Largest cosine of the angle between axes."""


class StrainGauge(Instrument):
    """Extension along one or several grids; with three of them (a rosette) the strain tensor, too.

    A grid measures the mean of the strain along its length, which is the relative displacement of its ends along it
    over the length; grids are centred at the point. Without a length it measures at the point. For a rosette
    extension = xx cos^2 + yy sin^2 + 2 xy sin cos at the three angles gives the three components. On a face of a solid
    whose grids are not in a plane of x and y, `axes` are the two directions along the face; x and y of this formula are
    then these.
    """

    example: ClassVar[str] = (
        '{ kind = "strain_gauge", name = "rosette", interval = 2e-7, point = [5.3e-3, 2.2e-3], length = 1e-3, '
        'angles = ["0 deg", "45 deg", "90 deg"], bandwidth = 1e6 }'
    )

    point: Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]
    """Centre of the gauge."""
    body: str | None = None
    """Name of the body, required at a point of several bodies."""
    angles: Annotated[list[float], Field(min_length=1), Unit("rad")] = [0.0]
    """Angles of the grids, from x towards y, or from the first of `axes` towards the second."""
    axes: Annotated[list[Direction], Field(min_length=2, max_length=2)] | None = None
    """In 3D two directions at right angles along the face of the gauge, of any length; default is x and y."""
    length: Length | None = None
    """Length of the grids."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.point", self.point, "xyz" if plane == "solid" else "xy")
        if plane == "antiplane":
            raise ValueError(f"{key}: plane = 'antiplane' extends nothing in the plane; use a receiver")
        if len(self.angles) == 3 and abs(np.linalg.det(self._rosette())) < 1e-6:
            raise ValueError(f"{key}.angles = {self.angles}: of a rosette all three must differ, modulo 180 degrees")
        if self.axes is not None:
            if plane != "solid":
                raise ValueError(f"{key}.axes: in plane = '{plane}' angles are from x towards y; remove axes")
            lengths = np.linalg.norm(self.axes, axis=1)
            if not lengths.all() or abs(np.dot(*np.array(self.axes))) > STRAIGHT * lengths.prod():
                raise ValueError(f"{key}.axes = {self.axes}: must be two directions at right angles, such as "
                                 "[[1, 0, 0], [0, 0, 1]] for a face of x and z")  # fmt: skip

    def _directions(self) -> np.ndarray:
        """Return the unit vectors from and towards which angles are measured, shape (2, dim)."""
        if self.axes is None:
            return np.eye(2, len(self.point))
        return np.array(self.axes) / np.linalg.norm(self.axes, axis=1)[:, None]

    def _labels(self) -> tuple[str, str]:
        """Return the names of these directions: axes of the coordinates, otherwise 1 and 2."""
        along = [[name for name, part in zip("xyz", row, strict=False) if part > 1 - STRAIGHT]
                 for row in self._directions()]  # fmt: skip
        return (along[0][0], along[1][0]) if all(along) else ("1", "2")

    @property
    def extent(self) -> float:
        return self.length or 0.0

    @property
    def points(self) -> list[tuple[list[float], str | None]]:
        return [(self.point, self.body)]

    def _rosette(self) -> np.ndarray:
        """Return the matrix from xx, yy, xy to the extension of every grid."""
        c, s = np.cos(self.angles), np.sin(self.angles)
        return np.stack([c**2, s**2, 2 * s * c], axis=1)

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        grids = [self._grid(readings, key, angle) for angle in self.angles]
        a, b = self._labels()
        base = "axis 1" if a == "1" else a
        items = [
            Channel(f"extension_{number + 1}", "1", f"extension at {np.degrees(angle):.6g} degrees from {base}", shares)
            for number, (angle, shares) in enumerate(zip(self.angles, grids, strict=True))
        ]
        if len(grids) == 3:
            for label, row in zip((a + a, b + b, a + b), np.linalg.inv(self._rosette()), strict=True):
                parts = [
                    Share(share.source, share.places, weight * share.weights)
                    for weight, shares in zip(row, grids, strict=True) for share in shares
                ]  # fmt: skip
                items.append(Channel(f"strain_{label}", "1", f"strain {label} of the rosette", parts))
        return items

    def _grid(self, readings: ModelReadings, key: str, angle: float) -> list[Share]:
        along = np.array([np.cos(angle), np.sin(angle)]) @ self._directions()
        if self.length is None:
            return [readings.point(self.point, self.body, key).extension(along)]
        shares = []
        for end in (0.5, -0.5):
            place = list(np.array(self.point) + end * self.length * along)
            where = readings.point(place, self.body, key, "length: the end")
            shares.append(where.motion("displacement", np.sign(end) * along / self.length))
        return shares
