"""Histories that are a profile of slip times a function of the time since its onset."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError
from ruptfx.input.units import VaryingDelay, VaryingHeight
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.slip_histories import History, SlipHistory

Array = np.ndarray
Rake = Annotated[float, Field(ge=-180, le=180)]


def along(rake: float | None, tangents: int) -> Array:
    """Return the unit vector of slip along the tangents.

    Raises
    ------
    CaseError
        A rake on a line.
    """
    if rake is None:
        return np.eye(tangents)[0]
    if tangents == 1:
        raise CaseError(
            f"rake = {rake:g}: slip along a line has no other direction; remove it, or give slip a minus sign"
        )
    return np.array([np.cos(np.radians(rake)), np.sin(np.radians(rake))])


class Directed(SlipHistory):
    """A history with an onset and a direction."""

    start: VaryingDelay = 0.0
    """Time at which slip begins; a rupture that spreads has a profile here."""
    rake: Rake | None = None
    """Direction of slip on a surface in degrees, from the first tangent (strike) to the second (down dip), as that of
    `initial_stress`; default is 0."""


class Growth(Directed):
    """Slip times a function of the time since the onset, which grows from 0 to 1."""

    slip: VaryingHeight
    """Final slip: jump of the tangential displacement, plus minus minus side; negative is backwards."""

    def grown(self, time: Array) -> Array:
        """Return the part of the slip at times since the onset [s], shape (n,); 0 until the onset."""
        raise NotImplementedError

    def growth(self, time: Array) -> Array:
        """Return the derivative of `grown` [1/s], shape (n,)."""
        raise NotImplementedError

    def sudden(self) -> float | Array:
        """Return the largest jump of `growth` [1/s]."""
        return 0.0

    def note(self) -> str:
        """Return what defaults make of the history, for `ruptfx check`."""
        return ""

    def bind(self, face: Interface, width: float) -> History:
        places, held = face.locations, self.reaches(face)
        part, direction = self.at(places), along(self.rake, face.tangents)
        slip, start = evaluate(part.slip, places), evaluate(part.start, places)
        jump = np.abs(slip) * np.broadcast_to(part.sudden(), slip.shape)
        return History(
            held,
            lambda time: (slip * part.grown(time - start))[:, None] * direction,
            lambda time: (slip * part.growth(time - start))[:, None] * direction,
            jump, self.note(),
        )  # fmt: skip


def ramp(time: Array, duration: Array | float, smoothing: Array | float) -> tuple[Array, Array]:
    """Return the growth from 0 to 1 whose rate rises and falls linearly over the smoothing, and the rate [1/s].

    The growth is the mean over the smoothing of one that is linear over the duration.
    """
    ends = [np.maximum(time - at, 0.0) for at in (0.0, smoothing, duration, duration + smoothing)]
    area = duration * smoothing
    parts = [0.5 * end**2 for end in ends]
    grown = (parts[0] - parts[1] - parts[2] + parts[3]) / area
    rate = (ends[0] - ends[1] - ends[2] + ends[3]) / area
    over = time >= duration + smoothing
    return np.where(over, 1.0, grown), np.where(over, 0.0, rate)
