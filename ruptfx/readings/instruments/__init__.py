"""Instruments, one kind per file; the file name is the `kind` of an entry of ``[[instruments]]``.

Every reading is a sum: of nodal displacements, velocities or accelerations, or of fields of a fault, times constant
weights. Hence the readings of all instruments of a run are one product with a sparse matrix, for every stepper and any
number of ranks. `ruptfx.run.recording.sampling` evaluates them at the times of each instrument.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo

from ruptfx import RuptfxError
from ruptfx.input.schema import Alternative, Name, alternative, find, kinds
from ruptfx.input.units import Duration, Frequency
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.bodies.space.inside import Inside
    from ruptfx.readings.instruments.model_readings import ModelReadings

Source = Literal["displacement", "velocity", "acceleration", "inelastic_force", "inelastic_stress"] | tuple[str, str]
"""A nodal field, or fault and field; inelastic forces are those of the elements of a rank, inelastic stresses those of
`InelasticStress`."""


@dataclass(frozen=True)
class Share:
    """Part of a reading: a weighted sum of values of a field; the shares of all ranks are added.

    Attributes
    ----------
    source : str or (str, str)
    places : ndarray of int, shape (n,)
        Local degrees of freedom, or local points of the fault.
    weights : ndarray, shape (n,)
    """

    source: Source
    places: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class Channel:
    """One quantity measured by an instrument.

    Attributes
    ----------
    name, unit, long_name : str
    shares : list of Share
    offset : float
        Value in the initial state, from which displacements are measured; the same on all ranks.
    """

    name: str
    unit: str
    long_name: str
    shares: list[Share]
    offset: float = 0.0


class Instrument(Alternative):
    """Contract of an instrument."""

    example: ClassVar[str] = ""
    """Example table for a case of two plates in plane stress, 12 mm long and 4 mm high each."""

    name: Name
    """Name of its table in `instruments.h5`."""
    interval: Duration
    """Time between samples, which are at multiples of it, interpolated linearly between the steps."""
    bandwidth: Frequency | None = None
    """Frequency of half power of a low-pass filter with one pole; default is no filter."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        """Refuse invalid input for a plane with these displacement components (``xy``, ``z`` or ``xyz``).

        Raises
        ------
        ValueError
            Names the key, the value and the remedy.
        """

    def channels(self, readings: ModelReadings, key: str) -> list[Channel]:
        """Return the channels of the instrument; collective.

        Raises
        ------
        RuptfxError
            On all ranks, with the key, if a point does not exist.
        """
        raise NotImplementedError

    @property
    def extent(self) -> float:
        """Averaging length [m]; 0 for a measurement at a point."""
        return 0.0

    @property
    def grid(self) -> np.ndarray | None:
        """Coordinates of the points of a grid [m], shape (points, dim); None for a measurement at one place.

        The channels of a grid are in the order of their names, and for each name in that of the points.
        """
        return None

    @property
    def points(self) -> list[tuple[list[float], str | None]]:
        """Measured points of the bodies [m], with the body of each."""
        return []

    def places(self, model: Discretisation, key: str) -> list[Inside]:
        """Return the elements of the measured points; collective."""
        from ruptfx.bodies.space.inside import Inside

        return [Inside(model, point, body, key) for point, body in self.points]


def with_stations(entries: object, info: ValidationInfo) -> object:
    """Return the instruments of a case, with those at the stations of files in place of the tables that name a file.

    Raises
    ------
    ValueError
    """
    from ruptfx.readings.instruments._stations import AtStations

    if not isinstance(entries, list):
        return entries
    tables: list[object] = []
    for number, entry in enumerate(entries):
        kind = str(entry.get("kind")) if isinstance(entry, Mapping) else ""
        cls = find("ruptfx.readings.instruments", kind) if kind in kinds("ruptfx.readings.instruments") else Instrument
        if isinstance(entry, Mapping) and isinstance(entry.get("stations"), str) and issubclass(cls, AtStations):
            directory = Path((info.context or {}).get("directory") or ".")
            try:
                tables += cls.of_stations(entry, directory, 3 if info.data.get("plane") == "solid" else 2)
            except (ValueError, RuptfxError) as error:
                raise ValueError(f"instruments.{number}.stations: {error}") from None
        else:
            tables.append(entry)
    return tables


if TYPE_CHECKING:
    AnyInstrument = Instrument
else:
    AnyInstrument = alternative("ruptfx.readings.instruments")

SHARED = ("model_readings",)
"""Files of this folder that are no kinds."""
