"""Schedule of checkpoints for a backward sweep in limited memory.

The steps of a run are segments of equal length. The history of the interfaces is kept for one segment at a time, and
copies of the whole state at the beginning of some others, from which their history is computed again. With n segments
and c checkpoints, the start of the run included, the binomial schedule of Griewank and Walther (2000), ACM Trans. Math.
Softw. 26, passes over the fewest segments:

    t(n, c) = r n - C(c + r, c + 1)        r the smallest integer with C(c + r, c) >= n

Then every segment is computed once more with its history. c = n makes every segment twice but the last one; all kept in
one segment nothing is computed again.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.quantities import at_least


def passed(segments: int, checkpoints: int) -> int:
    """Return t(n, c): the segments that a backward sweep passes without their history.

    Parameters
    ----------
    segments : int
        n
    checkpoints : int
        c, with the start of the run.
    """
    if checkpoints == 1:
        return segments * (segments - 1) // 2
    repeats = 0
    while comb(checkpoints + repeats, checkpoints) < segments:
        repeats += 1
    return repeats * segments - comb(checkpoints + repeats, checkpoints + 1)


def split(segments: int, checkpoints: int) -> int:
    """Return after how many segments the next checkpoint lies; of several best ones the first.

    Parameters
    ----------
    segments : int
        At least 2.
    checkpoints : int
        At least 2, with that at the beginning of the segments.
    """

    def cost(first: int) -> int:
        return first + passed(segments - first, checkpoints - 1) + passed(first, checkpoints)

    low, high = 1, segments - 1
    while low < high:  # the cost is convex
        middle = (low + high) // 2
        if cost(middle) <= cost(middle + 1):
            high = middle
        else:
            low = middle + 1
    return low


@dataclass(frozen=True)
class Schedule:
    """Checkpoints of a run.

    Attributes
    ----------
    steps : int
        Of the run.
    length : int
        Steps of a segment; the last one may be shorter.
    stored : int
        Largest number of checkpoints in memory, without the start of the run.
    memory : float
        Largest memory of history and checkpoints on all ranks [bytes].
    """

    steps: int
    length: int
    stored: int
    memory: float

    @property
    def segments(self) -> int:
        """Number of segments."""
        return -(-self.steps // self.length)

    def start(self, segment: int) -> int:
        """Return the first step of a segment; of one beyond the last one the number of steps."""
        return min(segment * self.length, self.steps)

    @property
    def forward_steps(self) -> int:
        """Steps forward of a run and the first backward sweep, at most: the last segment counts as a whole one."""
        if self.segments == 1:
            return self.steps
        return (passed(self.segments, self.stored + 1) + self.segments) * self.length

    @property
    def text(self) -> str:
        """Memory, checkpoints and recomputation, for messages."""
        size = f"{self.memory / 1e6:.3g} MB of memory"
        if self.segments == 1:
            return f"{size} for the history of {self.steps} steps, no checkpoints"
        checkpoints = f"{self.stored} checkpoint{'s' * (self.stored != 1)}"
        again = self.forward_steps / self.steps - 1
        kept = f"the history of {self.length} of {self.steps} steps"
        return f"{size} for {checkpoints} and {kept}; the others are computed again, {again:.3g} runs"


def schedule(steps: int, of_step: float, of_checkpoint: float, most: float) -> Schedule:
    """Return the schedule with the fewest steps in a memory.

    Parameters
    ----------
    of_step : float
        History of a step on all ranks [bytes].
    of_checkpoint : float
        State of a run on all ranks [bytes].
    most : float
        Memory on all ranks [bytes].

    Raises
    ------
    RuptfxError
        If it does not suffice for the history of one step.
    """
    memory_of_all = (steps + 1) * of_step
    if memory_of_all <= most:
        return Schedule(steps, steps, 0, memory_of_all)
    if 2 * of_step > most:
        raise RuptfxError(
            f"the history of the interfaces of one step needs {at_least(2e-9 * of_step, 4)} GB of memory, and at most "
            f"{most / 1e9:.3g} GB are allowed; use larger elements, or allow more with --memory"
        )
    largest = min(int((most - 2 * of_step) // of_checkpoint), steps - 1)
    counts = {*range(min(largest, 64) + 1), *np.geomspace(1, largest + 1, 400).astype(int).tolist(), largest + 1}
    items = []
    for stored in counts:
        length = min(int((most - stored * of_checkpoint) // of_step) - 1, steps)
        if stored > largest or length < 1:
            continue
        length = -(-steps // -(-steps // length))  # segments of equal length
        segments = -(-steps // length)
        kept = min(stored, segments - 1)
        items.append(Schedule(steps, length, kept, kept * of_checkpoint + (length + 1) * of_step))
    return min(items, key=lambda each: (each.forward_steps, each.memory))
