"""Motion, strain and stress at a point of the bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from ruptfx.bodies.boundaries import check_vector
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import Plane
from ruptfx.readings.instruments import Channel
from ruptfx.readings.instruments._stations import AtStations

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.bodies.space.inside import Inside
    from ruptfx.readings.instruments.model_readings import ModelReadings, SensedPoint

Quantity = Literal["velocity", "displacement", "strain", "stress"]


class Receiver(AtStations):
    """Velocity, displacement, strain and stress at a point anywhere in the bodies.

    The values are those of the element at the point, which need not be a node; at element boundaries the mean.
    Displacement and strain are measured from the initial state; the stress is total, with the initial stress of the
    bodies, tension positive. Strains are components of the tensor: xy is half of the angle of shear. A point above the
    surface, by half an element at most, is moved down to it, and every channel says so.
    """

    example: ClassVar[str] = '{ kind = "receiver", name = "point", interval = 2e-7, point = [5.3e-3, 2.2e-3] }'

    point: Annotated[list[float], Field(min_length=2, max_length=3), Unit("m")]
    """Coordinates of the receiver."""
    body: str | None = None
    """Name of the body, required at a point of several bodies."""
    fields: Annotated[list[Quantity], Field(min_length=1)] = ["velocity", "displacement", "strain", "stress"]
    """Recorded quantities."""
    on_surface: bool = False
    """Put the point on the upper surface of the bodies, whatever its last coordinate: z, in the plane y."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_vector(f"{key}.point", self.point, "xyz" if plane == "solid" else "xy")

    @property
    def points(self) -> list[tuple[list[float], str | None]]:
        return [(self.point, self.body)]

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        place, moved = readings.at_surface(self.point, self.body, key, self.on_surface)
        channels = channels_of(readings, place, self.fields)
        text = f", {moved}" if moved else ""
        return [replace(channel, long_name=channel.long_name + text) for channel in channels]

    def places(self, model: Discretisation, key: str) -> list[Inside]:
        from ruptfx.bodies.space.inside import Inside

        return [Inside.at_surface(model, self.point, self.body, key, anyhow=self.on_surface)]


def channels_of(readings: ModelReadings, place: SensedPoint, fields: Sequence[Quantity]) -> list[Channel]:
    """Return the channels of quantities at a point."""
    channels = []
    for field in dict.fromkeys(fields):
        if field in ("velocity", "displacement"):
            unit = "m/s" if field == "velocity" else "m"
            for label, number in readings.axes.items():
                share = place.motion(field, readings.unit_vector(number))
                channels.append(Channel(f"{field}_{label}", unit, f"{field} along {label}", [share]))
        for label, entry in readings.entries.items() if field in ("strain", "stress") else ():
            if field == "strain":
                channels.append(Channel(f"strain_{label}", "1", f"strain {label}", [place.strain(entry)]))
            else:
                text = f"total stress {label}, tension positive"
                channels.append(
                    Channel(f"stress_{label}", "Pa", text, place.stresses(label), place.initial_stress(label))
                )
    return channels
