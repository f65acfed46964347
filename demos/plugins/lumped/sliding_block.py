"""A block that friction stops."""

from typing import Annotated, ClassVar

import numpy as np
import xarray
from matplotlib.figure import Figure

from ruptfx.plugin import LumpedModel, Positive, Progress, Speed, Unit, silent, variable


class SlidingBlock(LumpedModel):
    """A block that Coulomb friction brings to rest."""

    example: ClassVar[str] = 'kind = "sliding_block"\nspeed = 2.0\nmu_d = 0.5\n'
    speed: Speed
    """Speed at the start."""
    mu_d: Positive
    """Friction coefficient of the block."""
    gravity: Annotated[Positive, Unit("m/s2")] = 9.81
    """Acceleration of free fall."""

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        duration = self.speed / (self.mu_d * self.gravity)
        time = np.linspace(0.0, duration, 101)
        distance = self.speed * time * (1 - 0.5 * time / duration)
        slip = variable("time", distance, "m", "slip")
        return xarray.Dataset({"slip": slip}, {"time": variable("time", time, "s", "time")})

    @staticmethod
    def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
        figure = Figure()
        dataset.slip.plot(ax=figure.add_subplot())
        return {"slip": figure}
