"""Result of an inference: best case, unknowns, runs, and data with fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.case import Case
from ruptfx.many_runs.inference.evaluations import Evaluation

if TYPE_CHECKING:
    import xarray

Floats = NDArray[np.float64]
PLAIN = 0.5  # of the misfit: what is left if the sign or the time of data is the cause


@dataclass(frozen=True)
class Fit:
    """Data of a reading with the fit.

    Attributes
    ----------
    name : str
        Instrument and channel.
    times, data, start, best : ndarray, shape (m,)
        [s], and data and readings of the first and of the best run.
    unit : str
        Of the data.
    """

    name: str
    times: Floats
    data: Floats
    start: Floats
    best: Floats
    unit: str = "1"


@dataclass(frozen=True)
class Recovered:
    """An unknown with its values.

    Attributes
    ----------
    key, unit, shape : str
    position, start, best : ndarray, shape (n,)
        At all points of the interface.
    band : ndarray, shape (2, n)
        Values one standard deviation of the prior below and above the case; without a prior those of the case.
    at_bound : bool
    interval : ndarray, shape (2, n), or None
        Ends of the interval of 68 % of the posterior.
    of_points : bool
        False for one number of terms of the objective or tied keys, which has no position.
    """

    key: str
    unit: str
    shape: str
    position: Floats
    start: Floats
    best: Floats
    band: Floats
    at_bound: bool
    interval: Floats | None
    of_points: bool = True


@dataclass(frozen=True)
class Result:
    """The recovered unknowns and the runs of the search; on all ranks.

    Attributes
    ----------
    case : Case
        The case with the best values.
    unknowns : list of Recovered
    runs : list of Evaluation
        All runs in their order.
    iterates : list of int
        Numbers of the runs that were accepted, the start and one for each iteration.
    data : int
        Number of data; half of it is the misfit that noise alone makes. Zero if terms have no independent data.
    reason : str
        Why it ended.
    fits : list of Fit
    samples : dict of str to ndarray, shape (count,)
        Samples of the posterior of all numbers by their keys, if it is known; entries belong together.
    """

    case: Case
    unknowns: list[Recovered]
    runs: list[Evaluation]
    iterates: list[int]
    data: int
    reason: str
    fits: list[Fit]
    samples: dict[str, Floats]

    @property
    def best(self) -> Evaluation:
        """The last accepted run."""
        return self.runs[self.iterates[-1]]

    @property
    def exceeds_noise(self) -> bool:
        """True if the misfit is more than four standard deviations above its mean for noise alone."""
        return self.data > 0 and 2 * self.best.misfit / self.data > 1 + 4 * (2 / self.data) ** 0.5

    def doubts(self) -> Iterator[str]:
        """Yield the traces that fit much better with the other sign, or at other times, than as they are."""
        from ruptfx.results.analysis.measured import misfit

        for fit in self.fits:
            if not fit.data.any() or not fit.best.any() or fit.times[-1] <= fit.times[0]:
                continue
            turned, as_it_is = (
                misfit(fit.times, sign * fit.best, fit.times, fit.data, what=fit.name) for sign in (-1.0, 1.0)
            )
            if turned.misfit < PLAIN * as_it_is.shifted:
                yield (
                    f"{fit.name} fits with the opposite sign, to {turned.misfit:.3g} of it instead of "
                    f"{as_it_is.misfit:.3g}: change the sign in its file"
                )
            elif as_it_is.shifted < PLAIN * as_it_is.misfit:
                late = "late" if as_it_is.shift > 0 else "early"
                yield (
                    f"{fit.name} fits as if {abs(as_it_is.shift):.3g} s too {late}, to {as_it_is.shifted:.3g} of it "
                    f"instead of {as_it_is.misfit:.3g}: make time_shift of its objective an unknown"
                )

    def dataset(self) -> xarray.Dataset:
        """Return unknowns, data, fit and misfits with positions and units."""
        import xarray

        data: dict[str, object] = {}
        for each in self.unknowns:
            dim = "point_" + each.key.split(".")[1] if each.of_points else "number"
            for name, values in (("case", each.start), ("best", each.best)):
                about = {"units": each.unit, "long_name": f"{each.key}, {name}"}
                data[f"{each.key}.{name}"] = (dim, values, about)
            for name, values in zip(("from", "to"), () if each.interval is None else each.interval, strict=False):
                about = {"units": each.unit, "long_name": f"{each.key}, interval of 68 %, {name}"}
                data[f"{each.key}.{name}"] = (dim, values, about)
            if each.of_points:
                data[f"position_{each.key.split('.')[1]}"] = (dim, each.position, {"units": "m"})
        for number, fit in enumerate(self.fits):
            dim = f"time_{number}"
            data[f"time_{number}"] = (dim, fit.times, {"units": "s"})
            for name, values in (("data", fit.data), ("case", fit.start), ("best", fit.best)):
                data[f"fit_{number}.{name}"] = (dim, values, {"long_name": f"{fit.name}, {name}"})
        for key, values in self.samples.items():
            data[f"{key}.samples"] = ("sample", values, {"long_name": f"{key}, samples of the posterior"})
        for name in ("misfit", "prior"):
            of_iterates = [getattr(self.runs[number], name) for number in self.iterates]
            data[name] = ("iteration", of_iterates, {"long_name": f"{name} of iterates"})
        data["run"] = ("iteration", [i + 1 for i in self.iterates], {"long_name": "number of the run"})
        return xarray.Dataset(data, attrs={"reason": self.reason, "data": self.data, "runs": len(self.runs)})
