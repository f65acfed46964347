"""Slip at a constant rate."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import evaluate
from ruptfx.input.units import Duration, Time, VaryingSlipRate
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.slip_histories import History
from ruptfx.interfaces.slip_histories._growth import Directed, along


class ConstantRate(Directed):
    """Slip at a constant rate, such as creep around and below a fault; it may begin and end gradually."""

    example: ClassVar[str] = '{ kind = "constant_rate", rate = 0.5, ramp = 1e-6 }'

    rate: VaryingSlipRate
    """Slip rate; negative is backwards."""
    ramp: Time = 0.0
    """Time over which the slip rate grows linearly from zero, and after the duration decreases; zero is at once."""
    duration: Duration | None = None
    """Time from the start until the slip rate begins to decrease; default is for ever."""

    def bind(self, face: Interface, width: float) -> History:
        places = face.locations
        part, direction = self.at(places), along(self.rake, face.tangents)
        rate, start = evaluate(part.rate, places), evaluate(part.start, places)
        ends = (0.0,) if self.duration is None else (0.0, self.duration)

        def parts(time: float) -> list[np.ndarray]:
            return [np.maximum(time - start - end, 0.0) for end in ends]

        def way(since: np.ndarray) -> np.ndarray:
            grows = np.minimum(since, self.ramp)
            return 0.5 * grows**2 / (self.ramp or 1.0) + np.maximum(since - self.ramp, 0.0)

        def speed(since: np.ndarray) -> np.ndarray:
            return np.minimum(since / self.ramp, 1.0) if self.ramp else (since > 0) + 0.0

        def alternating(values: list[np.ndarray]) -> np.ndarray:
            return (rate * (values[0] - sum(values[1:])))[:, None] * direction

        def slip_rate(time: float) -> np.ndarray:
            # At the very onset, too, so that what creeps from the start of a run does so in its first record.
            return alternating([speed(each + (1e-300 if number == 0 else 0.0) * (time - start >= 0))
                                for number, each in enumerate(parts(time))])  # fmt: skip

        return History(
            self.reaches(face), lambda time: alternating([way(each) for each in parts(time)]), slip_rate,
            np.zeros_like(rate) if self.ramp else np.abs(rate),
        )  # fmt: skip
