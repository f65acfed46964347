"""A block that friction stops."""

from typing import ClassVar

import numpy as np
import xarray
from matplotlib.figure import Figure

from ruptfx.plugin import LumpedModel, Positive, Progress, Speed, silent, variable


class SlidingBlock(LumpedModel):
    """A block that Coulomb friction brings to rest."""

    example: ClassVar[str] = 'kind = "sliding_block"\nspeed = 2.0\nmu_d = 0.5\n'
    speed: Speed
    """Speed at the start."""
    mu_d: Positive
    """Friction coefficient of the block."""

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        rest = self.speed / (self.mu_d * 9.81)
        time = np.linspace(0.0, rest, 101)
        way = self.speed * time * (1 - 0.5 * time / rest)
        slip = variable("time", way, "m", "slip")
        return xarray.Dataset({"slip": slip}, {"time": variable("time", time, "s", "time")})

    @staticmethod
    def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
        figure = Figure()
        dataset.slip.plot(ax=figure.add_subplot())
        return {"slip": figure}
