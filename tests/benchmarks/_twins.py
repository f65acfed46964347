"""Bodies of a reconstruction with the rows of their gauges, for the benchmarks of reconstructions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.case import Case
from ruptfx.many_runs.reconstruction.experiment import Experiment
from ruptfx.many_runs.reconstruction.twin import Twin

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

Floats = NDArray[np.float64]


class Bodies:
    """The bodies of a case with the rows of its gauges.

    Parameters
    ----------
    case : Case
    comm : MPI communicator
    interval, begin : float
        Interval of the knots, and their begin [s].
    """

    def __init__(self, case: Case, comm: MPI.Comm, interval: float, begin: float = 0.0) -> None:
        self.case = case
        experiment = Experiment(case)
        self.twin = Twin(case, comm, interval=interval, begin=begin, end=experiment.end)
        experiment.bind(self.twin.model)
        self._readings = self.twin.readings(experiment.requests)
        lags = [
            {clock: self.twin.lags(self._readings, number, clock) for clock in self._readings.sources(number)}
            for number in range(len(experiment.channels))
        ]
        self.still = self.twin.run(self._readings)
        self.rows = experiment.rows(
            self.twin.knots, lambda number, phase: self.twin.kernel(self._readings, number, lags[number], phase),
            self.still.samples,
        )  # fmt: skip
        self.times, self.position = self.twin.knots.times, self.twin.position

    def traction(self, slip_rate: Floats) -> Floats:
        """Return the shear traction of a run [Pa], with the shape of `Twin.run`."""
        return self.twin.run(self._readings, slip_rate).shear_traction
