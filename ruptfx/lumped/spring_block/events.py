"""Events of the chain: which blocks detach together, how far the fronts run, how fast, and what the force loses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_WINDOW = 4  # blocks over which a front speed is taken


@dataclass(frozen=True)
class Breaks:
    """Broken contacts in the order of time, shape (records,)."""

    time: np.ndarray
    block: np.ndarray
    count: np.ndarray
    delay: float
    contacts: np.ndarray  # of each block, shape (blocks,)

    def detached(self, block: int, times: np.ndarray) -> np.ndarray:
        """Detached fraction of a block's contacts: those broken within the last `delay`, shape of `times`."""
        mine = self.block == block
        broken, total = self.time[mine], np.concatenate([[0], np.cumsum(self.count[mine])])
        now = total[np.searchsorted(broken, times, side="right")]
        return (now - total[np.searchsorted(broken, times - self.delay, side="right")]) / self.contacts[block]

    def detachments(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and blocks at which half of a block's contacts have become detached, in the order of time."""
        found = []
        for block in range(len(self.contacts)):
            mine = self.block == block
            after = self.detached(block, self.time[mine])
            before = after - self.count[mine] / self.contacts[block]
            found.append(self.time[mine][(after >= 0.5) & (before < 0.5)])
        blocks = np.repeat(np.arange(len(found)), [len(times) for times in found])
        order = np.argsort(np.concatenate(found), kind="stable")
        return np.concatenate(found)[order], blocks[order]


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
        Where it starts, the farthest detached block (counted from 1), how many different blocks, how often.
    large : bool
        Every block detaches and the force falls by more than the given amount.
    front_blocks, front_times : ndarray
        Blocks in the order of the chain and the time each first detaches [s].
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
        """Front speed [blocks/s] over every run of 4 consecutive blocks; infinite where they detach at once."""
        consecutive = self.front_blocks[_WINDOW:] - self.front_blocks[:-_WINDOW] == _WINDOW
        times = np.abs(self.front_times[_WINDOW:] - self.front_times[:-_WINDOW])[consecutive]
        with np.errstate(divide="ignore"):
            return _WINDOW / times


def catalogue(breaks: Breaks, time: np.ndarray, force: np.ndarray, large_drop: float) -> list[Event]:
    """Events of a run.

    Parameters
    ----------
    breaks : Breaks
    time, force : ndarray, shape (samples,)
        Sampled loading force [N].
    large_drop : float
        Least fall of the force [N] of a large event.
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
                float(t[0]), float(t[-1]), float(force[before]), drop, int(b[0]), int(front[-1]) + 1,
                len(front), len(b), large, front, t[first],
            )
        )
    return events


def before_sliding(events: list[Event]) -> list[Event]:
    """Precursors: what happens before the first large event (everything, if there is none)."""
    first = next((i for i, event in enumerate(events) if event.large), len(events))
    return events[:first]


@dataclass(frozen=True)
class SlowFront:
    """Blocks that detach one after the other, each alone: the one before has reattached.

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
        """Blocks per second."""
        return (self.last_block - self.first_block) / (self.end - self.start)


def slow_fronts(breaks: Breaks, until: float, least: int = 4) -> list[SlowFront]:
    """Runs of at least so many neighbouring blocks, each detached between 1 and 20 delays after the one before."""
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
    """Front speeds [blocks/s] of all events together."""
    return np.concatenate([event.speeds() for event in events] or [np.zeros(0)])


def chaining(event: Event) -> float:
    """Speed at which an event covers the chain over its local front speed; above 1 fronts start ahead of the first.

    This is how the model makes fronts faster than its waves: superposed fronts from several places.
    """
    local, whole = event.speeds(), np.ptp(event.front_times)
    return float(event.blocks / whole / np.median(local)) if len(local) and whole > 0 else float("nan")


def length_against_force(events: list[Event]) -> tuple[float, float]:
    """Slope [blocks/N] of precursor length = slope x force, and the correlation of the two."""
    force, length = np.array([e.force for e in events]), np.array([e.reach for e in events], float)
    if len(events) < 3 or np.ptp(force) == 0 or np.ptp(length) == 0:
        return float("nan"), float("nan")
    return float(force @ length / (force @ force)), float(np.corrcoef(force, length)[0, 1])
