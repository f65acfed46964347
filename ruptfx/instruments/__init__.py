"""What measures during a run, one kind per file; the file name is the `kind` of an entry of ``[[instruments]]``.

All that an instrument reads is a sum: of nodal displacements, velocities or accelerations, or of fields of a fault,
times weights that do not change. So the readings of all instruments of a run are one product with a sparse matrix,
which every stepper and any number of ranks can do. `ruptfx.recording.sampling` takes them at times of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from ruptfx.materials import Plane
from ruptfx.schema import Alternative, Name, alternative
from ruptfx.units import Duration, Frequency

if TYPE_CHECKING:
    from ruptfx.sensed import Sensed

Source = Literal["displacement", "velocity", "acceleration"] | tuple[str, str]
"""A nodal field, or fault and field."""


@dataclass(frozen=True)
class Share:
    """Part of a reading: the sum of some values of a field times weights; what the ranks have adds up.

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
    """One number that an instrument reads.

    Attributes
    ----------
    name, unit, long_name : str
    shares : list of Share
    offset : float
        Its value in the initial state, from which displacements are measured; the same on all ranks.
    """

    name: str
    unit: str
    long_name: str
    shares: list[Share]
    offset: float = 0.0


class Instrument(Alternative):
    """The contract of an instrument."""

    example: ClassVar[str] = ""
    """As a case of two plates in plane stress, 12 mm long and 4 mm high each, has it."""

    name: Name
    """Of its table in `instruments.h5`."""
    interval: Duration
    """Between its samples, which are at multiples of it: linear between the steps, so to second order in the step."""
    bandwidth: Frequency | None = None
    """Where a sine comes out with half of its power, of a low-pass filter with one pole; none without it."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        """Refuse what does not fit a plane, in which displacement has these components (``xy``, ``z`` or ``xyz``).

        Raises
        ------
        ValueError
            Names the key, the value and the remedy.
        """

    def channels(self, plates: Sensed, key: str) -> list[Channel]:
        """What it reads; collective.

        Raises
        ------
        RuptfxError
            On all ranks, naming the key: a place that is not there.
        """
        raise NotImplementedError

    @property
    def extent(self) -> float:
        """Length that it averages over [m]; 0 of what measures at a point."""
        return 0.0

    @property
    def points(self) -> list[tuple[list[float], str | None]]:
        """Points at which it looks at the bodies [m], and in which body each is meant."""
        return []


if TYPE_CHECKING:
    AnyInstrument = Instrument
else:
    AnyInstrument = alternative("ruptfx.instruments")
