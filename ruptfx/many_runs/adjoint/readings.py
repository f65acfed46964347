"""Linear readings of a run and their transposes: traces at given times, and fields of an interface at the end.

Displacement, velocity and the fields of interfaces are known at different times, as in
`ruptfx.run.recording.sampling`; a trace is filtered with the bandwidth of its instrument and interpolated linearly. The
transpose returns the factors of the fields after every step from those of the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.platform import parallel
from ruptfx.readings.filter import filtered
from ruptfx.readings.misfits import Final, Floats, Request, Sample, Trace

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model

Places = tuple[NDArray[np.int64], Floats]


NODAL = ("displacement", "velocity")


class Readings:
    """All readings of a run of a fixed number of equal steps.

    Parameters
    ----------
    dt : float
        [s]
    """

    def __init__(self, model: Model, dt: float, steps: int, requests: Sequence[Request]) -> None:
        self._model, self._dt, self._steps, self.requests = model, dt, steps, list(requests)
        self._faults = {fault.name: fault for fault in model.faults}
        self._own: dict[tuple[str, int], list[tuple[str, Places]]] = {}
        self._all: dict[tuple[str, int], list[tuple[str, Places]]] = {}
        self._series: dict[tuple[str, int], Floats] = {}
        for number, request in enumerate(self.requests):
            if isinstance(request, Trace):
                for share in request.channel.shares:
                    clock = share.source if isinstance(share.source, str) else "faults"
                    field = share.source if isinstance(share.source, str) else "/".join(share.source)
                    key = (clock, number)
                    self._own.setdefault(key, []).append((field, (share.places, share.weights)))
                    self._all.setdefault(key, []).append((field, self._complete(field, share.places, share.weights)))
                    self._series[key] = np.zeros(steps + 1)
        self._final: dict[int, Floats] = {}
        self._orders = {name: self._order(name) for name in {r.fault for r in self.requests if isinstance(r, Final)}}

    def _order(self, name: str) -> tuple[Floats, Floats]:
        face = self._faults[name].interface
        rows = parallel.share_rows(
            self._model.comm, np.column_stack([face.number, face.position, face.weight])[face.owned]
        )
        _, position, weight = rows[np.argsort(rows[:, 0])].T
        return position, weight

    def _complete(self, field: str, places: NDArray[np.int64], weights: Floats) -> Places:
        """Return places and weights with those of other ranks at the nodes and points that this rank has, too."""
        model = self._model
        if "/" not in field:
            vector = np.zeros(model.nodes * model.components)
            np.add.at(vector, places, weights)
            model.layout.sum_shared(vector)
            values = np.flatnonzero(vector)
            return values, vector[values]
        face = self._faults[field.split("/")[0]].interface
        rows = parallel.share_rows(model.comm, np.column_stack([face.number[places], weights]))
        complete = np.zeros(face.total)
        np.add.at(complete, rows[:, 0].astype(int), rows[:, 1])
        values = np.flatnonzero(complete[face.number])
        return values, complete[face.number[values]]

    # -- reading ---------------------------------------------------------------------------------------------------

    def observe(self, step: int, state: State) -> None:
        """Read the state after a number of steps, 0 at the start."""
        for (clock, number), parts in self._own.items():
            self._series[clock, number][step] = sum(
                float(weights @ self._field(state, field)[places]) for field, (places, weights) in parts
            )
        if step == self._steps:
            for number, request in enumerate(self.requests):
                if isinstance(request, Final):
                    self._final[number] = state.faults[request.fault][request.field].copy()

    def observe_change(
        self, step: int, displacement: Floats, velocity: Floats, fields: dict[str, dict[str, Floats]]
    ) -> None:
        """Read changes of the fields, as `observe` reads the state."""
        for (clock, number), parts in self._own.items():
            total = 0.0
            for field, (places, weights) in parts:
                name, _, label = field.partition("/")
                if label:
                    values = fields[name][label] if step else np.zeros(len(self._faults[name].interface.weight))
                else:
                    values = displacement if field == "displacement" else velocity
                total += float(weights @ values[places])
            self._series[clock, number][step] = total
        if step == self._steps:
            for number, request in enumerate(self.requests):
                if isinstance(request, Final):
                    self._final[number] = fields[request.fault][request.field].copy()

    def _field(self, state: State, field: str) -> Floats:
        name, _, label = field.partition("/")
        if label:
            return state.faults[name][label]
        return state.displacement if field == "displacement" else state.velocity

    def samples(self) -> list[Sample]:
        """Return the values of all readings; collective."""
        keys = list(self._series)
        summed = parallel.total(self._model.comm, np.array([self._series[key] for key in keys]))
        series = dict(zip(keys, summed, strict=True))
        items = []
        for number, request in enumerate(self.requests):
            if isinstance(request, Final):
                face = self._faults[request.fault].interface
                complete = np.zeros(face.total)
                complete[face.number[face.owned]] = self._final[number][face.owned]
                position, weight = self._orders[request.fault]
                items.append(Sample(position, parallel.total(self._model.comm, complete), weight))
                continue
            clocks = [clock for clock, which in keys if which == number]
            times = self._times(request, clocks[0])
            values, slopes = np.full(len(times), request.channel.offset), np.zeros(len(times))
            for clock in clocks:
                own, raw = self._clock(clock, series[clock, number])
                known = filtered(own, raw, request.bandwidth)
                values += np.interp(times, own, known)
                slopes += _slopes(times, own, known)
            items.append(Sample(times, values, np.ones(len(times)), slopes))
        return items

    def sources(self, number: int) -> dict[str, list[tuple[str, Places]]]:
        """Return the weighted fields of a trace by their clock, with places and weights at all nodes of this rank."""
        return {clock: parts for (clock, which), parts in self._all.items() if which == number}

    def trace_of(self, number: int, series: Mapping[str, Floats], times: Floats) -> Floats:
        """Return a trace at times from the readings of its sources after every step, shape (times, n).

        Parameters
        ----------
        number : int
            Of the request.
        series : mapping of str to ndarray, shape (steps + 1, n)
            By clock.
        times : ndarray, shape (times,)
        """
        request = self.requests[number]
        assert isinstance(request, Trace)
        total = np.zeros((len(times), next(iter(series.values())).shape[1]))
        for clock, values in series.items():
            own, raw = self._clock(clock, values)
            known = filtered(own, raw, request.bandwidth)
            after, part = _between(times, own)
            total += known[after - 1] * (1 - part)[:, None] + known[after] * part[:, None]
        return total

    def _times(self, request: Trace, clock: str) -> Floats:
        return request.times if request.times is not None else self._clock(clock, np.zeros(self._steps + 1))[0]

    def _clock(self, clock: str, series: Floats) -> tuple[Floats, Floats]:
        """Return the times at which a source is known, and its readings, from those after every step."""
        n, dt = np.arange(self._steps + 1), self._dt
        if clock == "displacement":
            return np.asarray(n * dt), series
        if clock == "faults":
            return np.asarray(n[:-1] * dt), series[1:]
        middle = np.maximum(n - 0.5, 0.0) * dt
        if clock == "velocity":
            return middle, series
        change = np.concatenate([np.zeros_like(series[:1]), (np.diff(series, axis=0).T / np.diff(middle)).T])
        return np.concatenate([[0.0], 0.5 * (middle[1:] + middle[:-1])]), change

    # -- transpose -------------------------------------------------------------------------------------------------

    def seed(self, factors: Sequence[Floats]) -> Seeds:
        """Return the factors of the fields after every step from those of the values of all readings."""
        of_steps: dict[tuple[str, int], Floats] = {}
        last: dict[tuple[str, str], Floats] = {}
        for number, (request, factor) in enumerate(zip(self.requests, factors, strict=True)):
            if isinstance(request, Final):
                face = self._faults[request.fault].interface
                key = (request.fault, request.field)
                last[key] = last.get(key, 0.0) + factor[face.number]
                continue
            for clock in [clock for clock, which in self._series if which == number]:
                own, _ = self._clock(clock, np.zeros(self._steps + 1))
                times = self._times(request, clock)
                of_own = _filtered_transposed(own, _interpolated_transposed(times, own, factor), request.bandwidth)
                of_steps[clock, number] = self._clock_transposed(clock, of_own)
        return Seeds(of_steps, last, self._all, self._steps)

    def _clock_transposed(self, clock: str, factor: Floats) -> Floats:
        if clock in NODAL:
            return factor
        clock_transposed = np.zeros(self._steps + 1)
        if clock == "faults":
            clock_transposed[1:] = factor
            return clock_transposed
        rate = factor[1:] / np.diff(np.maximum(np.arange(self._steps + 1) - 0.5, 0.0) * self._dt)
        clock_transposed[1:] += rate
        clock_transposed[:-1] -= rate
        return clock_transposed


class Seeds:
    """Factors of the fields after every step."""

    def __init__(
        self, series: dict[tuple[str, int], Floats], last: dict[tuple[str, str], Floats],
        places: dict[tuple[str, int], list[tuple[str, Places]]], steps: int,
    ) -> None:  # fmt: skip
        self._series, self._last, self._places, self._steps = series, last, places, steps

    def at(self, step: int) -> Iterator[tuple[str, NDArray[np.int64], Floats]]:
        """Yield factors of displacement and velocity after a step: field, degrees of freedom, values."""
        for (clock, number), series in self._series.items():
            if clock != "faults" and series[step]:
                for _, (places, weights) in self._places[clock, number]:
                    yield "displacement" if clock == "displacement" else "velocity", places, series[step] * weights

    def add(self, step: int, fields: dict[str, dict[str, Floats]]) -> None:
        """Add the factors of the fields of interfaces after a step to arrays by fault and field."""
        for (clock, number), series in self._series.items():
            if clock == "faults" and series[step]:
                for field, (places, weights) in self._places[clock, number]:
                    name, _, label = field.partition("/")
                    fields[name][label][places] += series[step] * weights  # each place is there once
        if step == self._steps:
            for (name, label), factor in self._last.items():
                fields[name][label] += factor


def _filtered_transposed(times: Floats, factor: Floats, bandwidth: float | None) -> Floats:
    if bandwidth is None:
        return factor
    constant, filtered_transposed, carried = 0.5 / np.pi / bandwidth, np.zeros_like(factor), 0.0
    for n in range(len(factor) - 1, 0, -1):
        # smooth_n = x_n - lag + (smooth_(n-1) - x_(n-1) + lag) decay, lag = (x_n - x_(n-1)) constant / step
        step = times[n] - times[n - 1]
        decay, per = np.exp(-step / constant), constant / step
        carried += factor[n]
        filtered_transposed[n] += carried * (1 - per + per * decay)
        filtered_transposed[n - 1] += carried * (per - decay - per * decay)
        carried *= decay
    filtered_transposed[0] += carried + factor[0]
    return filtered_transposed


def _slopes(times: Floats, own: Floats, values: Floats) -> Floats:
    """Return the slopes of linear interpolation; zero outside of the known times."""
    after = np.clip(np.searchsorted(own, times), 1, len(own) - 1)
    slopes = (values[after] - values[after - 1]) / (own[after] - own[after - 1])
    return np.where((times >= own[0]) & (times <= own[-1]), slopes, 0.0)


def _interpolated_transposed(times: Floats, own: Floats, factor: Floats) -> Floats:
    values = np.zeros(len(own))
    after, part = _between(times, own)
    np.add.at(values, after - 1, (1 - part) * factor)
    np.add.at(values, after, part * factor)
    return values


def _between(times: Floats, own: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return the next known time of each time, and the part of the interval before it that has passed."""
    after = np.clip(np.searchsorted(own, times), 1, len(own) - 1)
    return after, np.clip((times - own[after - 1]) / (own[after] - own[after - 1]), 0.0, 1.0)
