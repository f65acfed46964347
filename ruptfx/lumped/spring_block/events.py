"""Events of the chain: joint detachments, reach and speed of fronts, and force drops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_WINDOW = 4  # blocks over which a front speed is fitted


@dataclass(frozen=True)
class Breaks:
    """Broken contacts in chronological order, shape (records,)."""

    time: np.ndarray
    block: np.ndarray
    count: np.ndarray
    delay: float
    contacts: np.ndarray  # of each block, shape (blocks,)

    def detached(self, block: int, times: np.ndarray) -> np.ndarray:
        """Return the detached fraction of a block's contacts (broken within the last `delay`), shape of `times`."""
        mine = self.block == block
        broken, total = self.time[mine], np.concatenate([[0], np.cumsum(self.count[mine])])
        now = total[np.searchsorted(broken, times, side="right")]
        return (now - total[np.searchsorted(broken, times - self.delay, side="right")]) / self.contacts[block]

    def detachments(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and blocks at which half of a block's contacts are detached, shape (events,), by time."""
        items = []
        for block in range(len(self.contacts)):
            mine = self.block == block
            after = self.detached(block, self.time[mine])
            before = after - self.count[mine] / self.contacts[block]
            items.append(self.time[mine][(after >= 0.5) & (before < 0.5)])
        blocks = np.repeat(np.arange(len(items)), [len(times) for times in items])
        order = np.argsort(np.concatenate(items), kind="stable")
        return np.concatenate(items)[order], blocks[order]


@dataclass(frozen=True)
class Event:
    """Detachments that follow each other within twice the reattachment delay.

    Attributes
    ----------
    start, end : float
        First and last detachment [s].
    force, drop : float
        Loading force before the event and its largest fall during it [N].
    first_block, reach, blocks, detachments : int
        First block, farthest detached block (counted from 1), number of different blocks, number of detachments.
    large : bool
        Every block detaches and the force falls by more than the given amount.
    front_blocks, front_times : ndarray
        Blocks in the order of the chain, and the first detachment of each [s].
    """

    start: float
    end: float
    force: float
    drop: float
    first_block: int
    reach: int
    blocks: int
    detachments: int
    large: bool
    front_blocks: np.ndarray
    front_times: np.ndarray

    def speeds(self) -> np.ndarray:
        """Return the front speed [blocks/s] over every run of 4 blocks; infinite for simultaneous detachment."""
        consecutive = self.front_blocks[_WINDOW:] - self.front_blocks[:-_WINDOW] == _WINDOW
        times = np.abs(self.front_times[_WINDOW:] - self.front_times[:-_WINDOW])[consecutive]
        with np.errstate(divide="ignore"):
            return _WINDOW / times


def catalogue(breaks: Breaks, time: np.ndarray, force: np.ndarray, large_drop: float) -> list[Event]:
    """Return the events of a run.

    Parameters
    ----------
    breaks : Breaks
    time, force : ndarray, shape (samples,)
        Sampled loading force [N].
    large_drop : float
        Smallest force drop [N] of a large event.
    """
    times, blocks = breaks.detachments()
    if not len(times):
        return []
    cuts = np.flatnonzero(np.diff(times) > 2 * breaks.delay) + 1
    events = []
    for t, b in zip(np.split(times, cuts), np.split(blocks, cuts), strict=True):
        before = max(int(np.searchsorted(time, t[0])) - 1, 0)
        after = int(np.searchsorted(time, t[-1] + breaks.delay)) + 1
        drop = max(float(force[before] - force[before:after].min()), 0.0)
        front, first = np.unique(b, return_index=True)
        large = len(front) == len(breaks.contacts) and drop >= large_drop
        events.append(
            Event(
                float(t[0]),
                float(t[-1]),
                float(force[before]),
                drop,
                int(b[0]),
                int(front[-1]) + 1,
                len(front),
                len(b),
                large,
                front,
                t[first],
            )
        )
    return events


def before_sliding(events: list[Event]) -> list[Event]:
    """Return the precursors: events before the first large one (all events, if there is none)."""
    first = next((i for i, event in enumerate(events) if event.large), len(events))
    return events[:first]


@dataclass(frozen=True)
class SlowFront:
    """Blocks that detach one after the other, each after the previous one has reattached.

    Attributes
    ----------
    start, end : float
        Time [s] of the first and last detachment.
    first_block, last_block : int
    """

    start: float
    end: float
    first_block: int
    last_block: int

    @property
    def speed(self) -> float:
        """Front speed [blocks/s]."""
        return (self.last_block - self.first_block) / (self.end - self.start)


def slow_fronts(breaks: Breaks, until: float, least: int = 4) -> list[SlowFront]:
    """Return runs of at least `least` neighbouring blocks, each detached 1 to 20 delays after the previous one."""
    last: dict[int, SlowFront] = {}
    fronts = []
    for time, block in zip(*breaks.detachments(), strict=True):
        if time > until:
            break
        before = last.pop(int(block) - 1, None)
        follows = before is not None and breaks.delay < time - before.end < 20 * breaks.delay
        if before is not None and not follows:
            fronts.append(before)
        start = before if follows and before is not None else SlowFront(time, time, int(block), int(block))
        last[int(block)] = SlowFront(start.start, float(time), start.first_block, int(block))
    fronts += last.values()
    return [front for front in fronts if front.last_block - front.first_block + 1 >= least]


def local_speeds(events: list[Event]) -> np.ndarray:
    """Return the front speeds [blocks/s] of all events together."""
    return np.concatenate([event.speeds() for event in events] or [np.zeros(0)])


def chaining(event: Event) -> float:
    """Return the speed at which an event covers the chain over its local front speed.

    Above 1 fronts start ahead of the first one: superposed fronts from several positions outrun the waves of the chain.
    """
    local, total_time = event.speeds(), np.ptp(event.front_times)
    return float(event.blocks / total_time / np.median(local)) if len(local) and total_time > 0 else float("nan")


def length_against_force(events: list[Event]) -> tuple[float, float]:
    """Return the slope [blocks/N] of precursor length = slope x force, and the correlation of the two."""
    force, length = np.array([e.force for e in events]), np.array([e.reach for e in events], float)
    if len(events) < 3 or np.ptp(force) == 0 or np.ptp(length) == 0:
        return float("nan"), float("nan")
    return float(force @ length / (force @ force)), float(np.corrcoef(force, length)[0, 1])
