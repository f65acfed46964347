"""How many points of a study are done, shown while it runs."""

from __future__ import annotations

from collections.abc import Sequence

from ruptfx.many_runs.study.store import Result
from ruptfx.platform.progress import Progress


class Count:
    """Progress display: total, finished and failed points.

    Attributes
    ----------
    note : str
        Text after the numbers.
    """

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress, self._title = progress, title
        self._added = self._expected = self._done = self._failed = 0
        self.note = ""

    @property
    def _total(self) -> int:
        return max(self._added, self._expected)

    def expect(self, count: int) -> None:
        """Set the total number of points if they are added in portions."""
        self._expected = count

    def add(self, count: int, known: Sequence[Result]) -> None:
        """Add points, some of them with known results."""
        self._added += count
        for result in known:
            self._count(result)

    def finished(self, result: Result) -> None:
        """Count a finished point."""
        self._count(result)
        self._progress.update(
            (self._done + self._failed) / self._total,
            f"{self._title}: {self._total} points, {self._done} done, {self._failed} failed{self.note}",
        )

    def _count(self, result: Result) -> None:
        failed = result["status"] == "failed"
        self._failed, self._done = self._failed + failed, self._done + (not failed)
