"""Times of records: the multiples of an interval, however long a run is."""

from __future__ import annotations

from math import ceil, floor

SLACK = 1e-9  # relative tolerance of times, for rounding


class Schedule:
    """Multiples of an interval by their number, each due after the first step that reaches it.

    Parameters
    ----------
    interval : float
        [s]
    """

    def __init__(self, interval: float) -> None:
        self._spacing = (1 - SLACK) * interval

    def due(self, number: int, time: float) -> bool:
        """Return whether a time [s] has reached a multiple."""
        return time >= number * self._spacing

    def after(self, time: float) -> int:
        """Return the number of the first multiple that a time [s] has not reached."""
        number = floor(time / self._spacing)
        return number + 1 if self.due(number, time) else number


def end_of(duration: float) -> float:
    """Return the time from which a run of a duration is complete [s], early by rounding."""
    return (1 - SLACK) * duration


def count(interval: float, duration: float) -> int:
    """Return the number of records after the first, the last of which is that of the end."""
    return max(1, ceil((1 - SLACK) * duration / interval))
