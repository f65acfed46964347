"""Slip whose rate is half a period of a cosine squared."""

from typing import ClassVar

import numpy as np

from ruptfx.plugin import Duration, History, Interface, SlipHistory, VaryingHeight, evaluate


class HalfCosine(SlipHistory):
    """Slip that grows as t - sin(2 pi t) / (2 pi), t from 0 to 1 over the rise time."""

    example: ClassVar[str] = '{ kind = "half_cosine", slip = 1e-6, rise_time = 2e-6 }'
    slip: VaryingHeight
    """Final slip along the first tangent."""
    rise_time: Duration
    """Time over which slip grows."""

    def bind(self, face: Interface, width: float) -> History:
        final = evaluate(self.slip, face.locations)[:, None] * np.eye(face.tangents)[0]

        def part(time: float) -> float:
            return min(max(time / self.rise_time, 0.0), 1.0)

        return History(
            held=self.reaches(face),
            slip=lambda time: final * (part(time) - np.sin(2 * np.pi * part(time)) / (2 * np.pi)),
            rate=lambda time: final * (1 - np.cos(2 * np.pi * part(time))) / self.rise_time,
            jump=np.zeros(len(final)),
        )
