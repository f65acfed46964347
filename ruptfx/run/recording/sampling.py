"""Readings of all instruments, each at its own times.

Displacement, velocity, acceleration, the fields of faults and the inelastic forces of materials with memory are known
at different times: in explicit runs at t, t - dt / 2, t - dt, t - dt and t - dt, where t is that of the state. Each is
filtered with the bandwidth of its instrument, interpolated linearly between its own times, and read at the multiples of
the interval: all numbers of a sample are of one time, to second order in the step. Ranks do this with their own nodes;
only samples are summed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.input.quantities import at_least
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.mechanisms.memory import inelastic_force
from ruptfx.readings.filter import low_pass
from ruptfx.readings.instruments import Channel, Instrument, Source
from ruptfx.readings.instruments.model_readings import ModelReadings, Stresses

if TYPE_CHECKING:
    from scipy import sparse

    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model

SLACK = 1e-9  # relative tolerance of times, for rounding


class SampleBuffer:
    """Readings of channels at the same times and samples of them, on this rank.

    Parameters
    ----------
    intervals : dict of int to float
        Interval between samples [s] of the groups of channels that need these readings.
    group : ndarray of int, shape (channels,)
    time_constant : ndarray, shape (channels,)
        Time constants of the filters [s]; 0 without a filter.
    """

    def __init__(self, intervals: dict[int, float], group: np.ndarray, time_constant: np.ndarray) -> None:
        self._intervals, self._constant = intervals, time_constant
        self._members = {number: np.flatnonzero(group == number) for number in intervals}
        self.time = -1.0
        self.raw = self.smooth = np.zeros(len(group))
        self.numbers = dict.fromkeys(intervals, 0)  # index of the next sample
        self.waiting: dict[int, list[np.ndarray]] = {number: [] for number in intervals}  # rows of samples

    def advance(self, time: float, raw: np.ndarray) -> None:
        """Advance to a time [s] with its readings, and take the samples that are due in between."""
        if time <= self.time or self.time < 0:  # the start, or its tractions, known in the first explicit step
            self.raw = raw
            if self.time <= 0:
                self.smooth = raw
            self.time = max(time, self.time)
            return
        before, step = self.smooth, time - self.time
        self.smooth = low_pass(self.raw, raw, self.smooth, step, self._constant)
        for group, interval in self._intervals.items():
            members = self._members[group]
            first, last = self.numbers[group], int(np.floor(time / interval * (1 + SLACK)))
            if last >= first:
                part = (interval * np.arange(first, last + 1) - self.time) / step
                change = self.smooth[members] - before[members]
                self.waiting[group].append(before[members] + part[:, None] * change)
                self.numbers[group] = last + 1
        self.raw, self.time = raw, time

    def rows(self, group: int) -> np.ndarray:
        """Return the samples in memory, shape (samples, channels of the group)."""
        return np.concatenate([np.zeros((0, len(self._members[group]))), *self.waiting[group]])

    def table(self) -> Table:
        """Return all data that change, as numbers and lists."""
        return {
            "time": self.time, "raw": self.raw.tolist(), "smooth": self.smooth.tolist(),
            "numbers": list(self.numbers.values()), "waiting": [self.rows(group).tolist() for group in self.waiting],
        }  # fmt: skip

    def restore(self, times: Table, tables: list[Table]) -> None:
        """Continue at the times of a table with the sum of the data of some ranks, zeros without any."""
        self.time, self.numbers = times["time"], dict(zip(self.numbers, times["numbers"], strict=True))

        def total(values: list[list[float]], shape: tuple[int, ...]) -> np.ndarray:
            return sum((np.reshape(each, shape) for each in values), np.zeros(shape))

        self.raw = total([table["raw"] for table in tables], self.raw.shape)
        self.smooth = total([table["smooth"] for table in tables], self.raw.shape)
        for number, (group, members) in enumerate(self._members.items()):
            shape = (len(times["waiting"][number]), len(members))
            self.waiting[group] = [total([table["waiting"][number] for table in tables], shape)]


class Samples:
    """Samples of the instruments of a run until they are written.

    Parameters
    ----------
    dt : float
        Time step [s], the first one if steps vary.
    initial_stress : callable, points -> stresses
        As in `ModelReadings`.

    Attributes
    ----------
    instruments : list of (Instrument, list of Channel)

    Raises
    ------
    CaseError
        On all ranks: an instrument outside of the bodies, or an interval below the step.
    """

    def __init__(self, model: Model, dt: float, initial_stress: Stresses) -> None:
        self._model, case = model, model.case
        readings = ModelReadings(model, initial_stress)
        self.instruments: list[tuple[Instrument, list[Channel]]] = []
        for number, instrument in enumerate(case.instruments):
            key = f"instruments.{number}"
            if instrument.interval < dt * (1 - SLACK) and not case.stepper.adaptive:
                raise CaseError(
                    f"{key}.interval = {instrument.interval:.6g} s: below the time step of {at_least(dt)} s, between "
                    "which nothing is known; make it longer, or the step shorter with stepper.time_step"
                )
            self.instruments.append((instrument, instrument.channels(readings, key)))
        channels = [channel for _, result in self.instruments for channel in result]
        owner = [instrument for instrument, result in self.instruments for _ in result]
        # One group for instruments of one interval with the same readings.
        needs = [(each.interval, _clocks(result)) for each, result in self.instruments for _ in result]
        groups = sorted(set(needs))
        self._intervals = [interval for interval, _ in groups]
        group = np.array([groups.index(need) for need in needs], dtype=int)
        constant = np.array([0.0 if each.bandwidth is None else 0.5 / np.pi / each.bandwidth for each in owner])
        self._group, self._offset = group, np.array([channel.offset for channel in channels])
        self._inelastic = readings.inelastic
        self._nodal, self._at_faults = self._weights(channels)
        if "inelastic_stress" in self._nodal:
            self._inelastic.choose(self._nodal["inelastic_stress"].indices)
        self._buffers = {}
        for clock in sorted({clock for _, clocks in groups for clock in clocks}):
            intervals = {number: interval for number, (interval, clocks) in enumerate(groups) if clock in clocks}
            self._buffers[clock] = SampleBuffer(intervals, group, constant)
        self._clocks = [clocks for _, clocks in groups]
        self._momentum = (-1.0, np.zeros(len(channels)))  # time and readings of the previous velocity
        self._written = [0] * len(self._intervals)

    def _weights(
        self, channels: list[Channel]
    ) -> tuple[dict[str, sparse.csr_matrix], dict[tuple[str, str], sparse.csr_matrix]]:
        """Return sparse matrices from nodal fields, and from fields of faults, to all readings."""
        entries: dict[Source, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
        for row, channel in enumerate(channels):
            for share in channel.shares:
                rows = np.full(len(share.places), row)
                entries.setdefault(share.source, []).append((rows, share.places, share.weights))
        sizes = {fault.name: len(fault.interface.position) for fault in self._model.faults}
        nodal: dict[str, sparse.csr_matrix] = {}
        at_faults: dict[tuple[str, str], sparse.csr_matrix] = {}
        if entries:
            from scipy import sparse  # a run without instruments starts without it
        for source, parts in entries.items():
            rows, places, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
            if isinstance(source, str):
                width = self._model.nodes * self._model.components
                if source == "inelastic_stress":
                    width = self._inelastic.size
                nodal[source] = sparse.csr_matrix((weights, (rows, places)), shape=(len(channels), width))
            else:
                width = sizes[source[0]]
                at_faults[source] = sparse.csr_matrix((weights, (rows, places)), shape=(len(channels), width))
        return nodal, at_faults

    @property
    def reads_bodies(self) -> bool:
        """True if an instrument reads displacement or velocity of the bodies at every step."""
        return bool(self.instruments and self._nodal)

    def observe(self, state: State) -> None:
        """Read the state after a step, or at the start; not with deferred bodies if `reads_bodies`."""
        if not self.instruments:
            return
        half = 0.5 * state.lag
        for clock, buffer in self._buffers.items():
            if clock == "displacement":
                buffer.advance(state.time, self._nodal[clock] @ state.displacement)
            elif clock == "velocity":
                buffer.advance(state.time - half, self._nodal[clock] @ state.velocity)
            elif clock == "acceleration":
                self._accelerate(buffer, state.time - half, self._nodal[clock] @ state.velocity)
            elif clock == "inelastic_force":
                buffer.advance(state.fault_time, self._nodal[clock] @ inelastic_force(self._model, state))
            elif clock == "inelastic_stress":
                buffer.advance(state.fault_time, self._nodal[clock] @ self._inelastic.read(state))
            else:
                faults = state.faults
                readings = [weights @ faults[name][field] for (name, field), weights in self._at_faults.items()]
                buffer.advance(state.fault_time, np.sum(readings, axis=0))

    def _accelerate(self, buffer: SampleBuffer, time: float, momentum: np.ndarray) -> None:
        """Read the change of a velocity over its time, at the middle: in explicit runs at the time of the forces."""
        then, before = self._momentum
        self._momentum = (time, momentum)
        if then < 0:
            buffer.advance(0.0, np.zeros_like(momentum))
        elif time > then:
            buffer.advance(0.5 * (then + time), (momentum - before) / (time - then))

    def gather(self) -> list[tuple[str, np.ndarray, list[np.ndarray]]]:
        """Return complete samples on rank 0: instrument, times [s], values by channel; collective."""
        blocks, counts = [], []
        for group, interval in enumerate(self._intervals):
            buffers = [self._buffers[clock] for clock in self._clocks[group]]
            parts = [buffer.rows(group) for buffer in buffers]
            end = int(np.floor(self._model.case.duration / interval * (1 + SLACK))) + 1 - self._written[group]
            count = min(min(len(part) for part in parts), max(end, 0))
            blocks.append(np.sum([part[:count] for part in parts], axis=0))
            for buffer, part in zip(buffers, parts, strict=True):
                buffer.waiting[group] = [part[count:]]
            counts.append(count)
        gathered = self._model.comm.gather(blocks, root=0)
        starts = list(self._written)
        self._written = [start + count for start, count in zip(starts, counts, strict=True)]
        if gathered is None:
            return []
        sums = [np.sum(parts, axis=0) for parts in zip(*gathered, strict=True)]
        return list(self._by_instrument(sums, starts))

    def _by_instrument(
        self, sums: list[np.ndarray], starts: list[int]
    ) -> Iterator[tuple[str, np.ndarray, list[np.ndarray]]]:
        columns = dict[int, np.ndarray]()
        for group, rows in enumerate(sums):
            members = np.flatnonzero(self._group == group)
            columns |= dict(zip(members.tolist(), (rows + self._offset[members]).T, strict=True))
        first = 0
        for instrument, channels in self.instruments:
            group = int(self._group[first])
            if len(sums[group]):
                times = self._intervals[group] * (starts[group] + np.arange(len(sums[group])))
                yield instrument.name, times, [columns[first + number] for number in range(len(channels))]
            first += len(channels)

    def table(self) -> Table | None:
        """Return all data that change, of every rank on rank 0, for a checkpoint; collective."""
        mine = {"trains": {clock: buffer.table() for clock, buffer in self._buffers.items()},
                "momentum": [self._momentum[0], self._momentum[1].tolist()]}  # fmt: skip
        ranks = self._model.comm.gather(mine, root=0)
        return None if ranks is None else {"written": self._written, "ranks": ranks}

    def restore(self, table: Table) -> None:
        """Continue from a checkpoint; on another number of ranks rank 0 takes the sum."""
        comm, ranks = self._model.comm, table["ranks"]
        self._written = list(table["written"])
        mine = ranks if comm.rank == 0 else []
        if len(ranks) == comm.size:
            mine = [ranks[comm.rank]]
        for clock, buffer in self._buffers.items():
            buffer.restore(ranks[0]["trains"][clock], [rank["trains"][clock] for rank in mine])
        momentum = np.sum([np.array(rank["momentum"][1]) for rank in mine], axis=0) + 0 * self._offset
        self._momentum = (ranks[0]["momentum"][0], momentum)


def _clocks(channels: list[Channel]) -> tuple[str, ...]:
    """Return the readings that channels need, by the times at which they are known."""
    sources = {share.source for channel in channels for share in channel.shares}
    return tuple(sorted({source if isinstance(source, str) else "faults" for source in sources}))
