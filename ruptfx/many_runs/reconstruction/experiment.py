"""Data of an experiment as readings of a twin: rows of kernels, response to known loads, clocks, gains and offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ruptfx import Table
from ruptfx.case import Case
from ruptfx.input.schema import CaseError, nearest
from ruptfx.many_runs.reconstruction.posterior import Rows
from ruptfx.many_runs.reconstruction.twin import ALIGNED
from ruptfx.platform.run_files import seal
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.readings.misfits import Measured, Misfit, Request, Sample, Trace, Unknown

if TYPE_CHECKING:
    from collections.abc import Callable

    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.many_runs.reconstruction.twin import Knots

    Kernel = Callable[[int, float], "Floats"]

Floats = NDArray[np.float64]
PHASES = 16
"""Largest number of different delays of the data of a channel after the knots."""
MOST = 20_000
"""Largest number of data."""
UNSEEN = 1e-9
"""Part of the largest response of a channel in the same unit below which a channel sees nothing of the interface."""
DATA = ("times", "data", "units", "sigma", "begin", "end", "time_shift", "gain", "offset", "channels", "missing",
        "time", "displacement_x", "displacement_y")  # fmt: skip
"""Keys of terms on which impulse responses do not depend."""


@dataclass(frozen=True)
class Channel:
    """Data of a channel in the unit of its reading, without gain and offset.

    Attributes
    ----------
    name, unit : str
        Instrument and channel, and SI unit.
    term, place : int
        Number of the term, and of the reading among those of the term.
    times, values, sigma : ndarray, shape (m,)
        Times of the run [s], data, and standard deviations of their noise.
    missing : int
        Number of further times without a sample.
    """

    name: str
    unit: str
    term: int
    place: int
    times: Floats
    values: Floats
    sigma: Floats
    missing: int = 0


class Experiment:
    """The data of a case.

    Parameters
    ----------
    case : Case

    Attributes
    ----------
    interval, end : float
        Shortest interval of the data, or that of the case, and their last time [s].
    channels : list of Channel
    requests : list of Request
    sensors : list of Table
        Descriptions on which impulse responses depend.

    Raises
    ------
    CaseError
        No data, and terms without data or noise.
    """

    def __init__(self, case: Case) -> None:
        self.case, self.terms = case, list(case.objective)
        if not self.terms:
            raise CaseError("objective: there are no data; add an entry [[objective]] of kind = 'traces' for every "
                            "instrument")  # fmt: skip
        spacings, ends = [], []
        for number, term in enumerate(self.terms):
            measured = term.measured()
            if measured is None or not hasattr(term, "sigma"):
                raise CaseError(f"objective.{number}.kind = '{term.kind()}': has no data with independent noise; use "
                                "'traces' or 'displacement_field'")  # fmt: skip
            shift = float(getattr(term, "time_shift", 0.0))
            ends += [float(each.times[-1]) + shift for each in measured if len(each.times)]
            spacings += [float(np.median(np.diff(each.times))) for each in measured if len(each.times) > 1]
        settings = case.reconstruction
        interval = settings.interval if settings is not None else None
        if interval is None and not spacings:
            raise CaseError("reconstruction.interval: missing, and no channel has two data; add it")
        self.interval, self.end = interval or min(spacings), min(max(ends, default=0.0), case.duration)
        self.channels: list[Channel] = []
        self.requests: list[Request] = []
        self.sensors: list[Table] = []

    def bind(self, model: System) -> None:
        """Read the requests of all terms from a model; collective.

        Raises
        ------
        CaseError
            On all ranks: what an objective refuses, too many data, and clocks without common times.
        """
        bodies = ModelReadings(model, lambda points: np.ones((len(points), 6)))
        for number, term in enumerate(self.terms):
            requests = [cast(Trace, each) for each in term.requests(bodies, f"objective.{number}")]
            pairs = cast("list[tuple[Floats, Floats]]", term.residuals([_sample(each) for each in requests]))
            for place, measured in enumerate(cast("list[Measured]", term.measured())):
                request, (residual, slope) = requests[place], pairs[place]
                # The residual (gain y + offset - d) / sigma is affine in the reading y.
                self.channels.append(Channel(
                    measured.name, request.channel.unit, number, place, cast(Floats, request.times),
                    -residual / slope, 1 / slope, measured.missing,
                ))  # fmt: skip
                self.requests.append(request)
                self.sensors.append(self._sensor(term, request))
        count = sum(len(each.times) for each in self.channels)
        if count > MOST:
            raise CaseError(f"objective: {count} data, and reconstruct computes with at most {MOST}; leave out times "
                            "with begin and end, or channels, or give every second sample")  # fmt: skip
        self._check_clocks()

    def _sensor(self, term: Misfit, request: Trace) -> Table:
        about: Table = {"channel": request.channel.name, "text": request.channel.long_name}
        named = {each.name: each for each in self.case.instruments}
        instrument = named.get(getattr(term, "instrument", ""))
        if instrument is not None:  # its bandwidth and interval act after the responses
            table = instrument.model_dump(mode="json", exclude={"name", "interval", "bandwidth"})
            return about | {"instrument": {"kind": instrument.kind(), **table}}
        place = [list(map(float, share.weights)) for share in request.channel.shares]
        return about | {"term": seal(term.model_dump(mode="json", exclude=set(DATA))), "weights": place}

    def _check_clocks(self) -> None:
        """Refuse channels whose times have nothing in common.

        Raises
        ------
        CaseError
        """
        long = [each for each in self.channels if len(each.times) > 1]
        if not long:
            return
        last, first = max(long, key=lambda each: each.times[0]), min(long, key=lambda each: each.times[-1])
        if last.times[0] > first.times[-1]:
            raise CaseError(
                f"objective.{last.term}.times: '{last.name}' has data from {last.times[0]:.6g} to {last.times[-1]:.6g} "
                f"s, after those of '{first.name}' (objective.{first.term}), {first.times[0]:.6g} to "
                f"{first.times[-1]:.6g} s: their clocks disagree; set time_shift of one of them, or leave it out"
            )

    def rows(self, knots: Knots, kernel: Kernel, still: list[Sample]) -> Rows:
        """Return the data; those before the start of slip have a kernel of zeros.

        Parameters
        ----------
        knots : Knots
        kernel : callable
            Kernel of a request by its number and delay after the knots, shape (knots, columns).
        still : list of Sample
            Readings of a run without slip.

        Raises
        ------
        CaseError
            Data at irregular times, and channels that see nothing of the interface.
        """
        kernels, parts, sizes = [np.zeros(0)], [], []
        for number, (channel, sample) in enumerate(zip(self.channels, still, strict=True)):
            lag, phase = knots.lags(channel.times)
            slips = lag >= 0
            phase = phase[slips]
            phases, which = np.unique(np.round(phase / ALIGNED), return_inverse=True)
            phases = np.bincount(which, phase) / np.maximum(np.bincount(which), 1)  # means of equal ones
            if len(phases) > PHASES:
                raise CaseError(
                    f"objective.{channel.term}.times: the data of '{channel.name}' have {len(phases)} different delays "
                    f"after multiples of the interval of {knots.interval:.6g} s, and at most {PHASES} are computed; "
                    "give data with constant intervals (interpolate them), or set reconstruction.interval to theirs"
                )
            of_data = np.zeros(len(lag), int)
            of_data[slips] = len(kernels) + which
            parts.append((of_data, np.maximum(lag, 0), channel.values - sample.values, channel.sigma))
            mine = [kernel(number, float(each)) for each in phases]
            last = int(lag.max()) + 1
            sizes.append([max((float(np.abs(each[:end]).max(initial=0.0)) for each in mine), default=0.0)
                          for end in (max(last, 0), None)])  # fmt: skip
            kernels += mine
        self._check_sight(np.array(sizes))
        kernels[0] = np.zeros_like(kernels[-1])
        of_data, lags, values, sigma = (np.concatenate(each) for each in zip(*parts, strict=True))
        return Rows(np.array(kernels), of_data, lags, values, sigma)

    def _check_sight(self, sizes: Floats) -> None:
        """Refuse channels that see nothing until their last datum; sizes of responses until then, and until the end.

        Raises
        ------
        CaseError
        """
        for channel, (size, _) in zip(self.channels, sizes, strict=True):
            alike = [other for each, (_, other) in zip(self.channels, sizes, strict=True) if each.unit == channel.unit]
            if size <= UNSEEN * max(alike):
                raise CaseError(
                    f"objective.{channel.term}: '{channel.name}' sees nothing of the interface: until "
                    f"{channel.times[-1]:.6g} s its largest response is {size:.3g} {channel.unit} per m/s; leave the "
                    "channel out (channels, or remove the entry), give later data, or put the sensor nearer to the "
                    "interface"
                )

    # -- clocks, gains and offsets -----------------------------------------------------------------------------------

    def unknowns(self) -> list[tuple[Unknown, list[int], str]]:
        """Return the unknowns of terms with the numbers of their terms and their parameter.

        Unknowns of the friction law are for its fit; others of the interface have no effect here.

        Raises
        ------
        CaseError
            No such term or parameter, and no standard deviation.
        """
        items = []
        for index, unknown in enumerate(self.case.unknowns):
            if unknown.tied:
                raise CaseError(f"unknowns.{index}.tied: ruptfx reconstruct has no tied keys; make each an unknown, or "
                                "use objective.*.NAME for all terms")  # fmt: skip
            folder, _, rest = unknown.key.partition(".")
            if folder != "objective":
                continue
            which, _, name = rest.partition(".")
            terms = list(range(len(self.terms))) if which == "*" else [int(which)] if which.isdigit() else []
            if not terms or max(terms) >= len(self.terms):
                raise CaseError(f"unknowns.{index}.key = '{unknown.key}': no such term; the last one is "
                                f"objective.{len(self.terms) - 1}, give its number")  # fmt: skip
            for term in terms:
                if name not in self.terms[term].parameters:
                    raise CaseError(f"unknowns.{index}.key = '{unknown.key}': no unknown of this term, "
                                    f"{nearest(name, list(self.terms[term].parameters))}")  # fmt: skip
            if unknown.sigma is None or unknown.scale != "linear":
                raise CaseError(f"unknowns.{index}: '{unknown.key}' needs a normal prior in ruptfx reconstruct; give "
                                "sigma, and scale = 'linear'")  # fmt: skip
            items.append((unknown, terms, name))
        return items

    def columns(self, fit: list[Floats]) -> Floats:
        """Return the changes of the data by one standard deviation of every unknown, shape (data, unknowns).

        Parameters
        ----------
        fit : list of ndarray
            Readings of all channels about which gains and times are linearised.
        """
        unknowns, parts = self.unknowns(), []
        for channel, values in zip(self.channels, fit, strict=True):
            slopes = np.gradient(values, channel.times) if len(values) > 1 else np.zeros(len(values))
            term, part = self.terms[channel.term], np.zeros((len(values), len(unknowns)))
            samples = [Sample(channel.times, values, np.ones(len(values)), slopes)] * (channel.place + 1)
            for column, (unknown, terms, name) in enumerate(unknowns):
                if channel.term in terms:
                    part[:, column] = cast(float, unknown.sigma) * term.change(name, samples)[channel.place]
            parts.append(part)
        return np.concatenate(parts)

    def split(self, values: Floats) -> list[Floats]:
        """Return values of all data by channel."""
        return np.split(values, np.cumsum([len(each.times) for each in self.channels])[:-1])


def _sample(request: Trace) -> Sample:
    """Return a reading of zero."""
    times = cast(Floats, request.times)
    return Sample(times, np.zeros(len(times)), np.ones(len(times)))
