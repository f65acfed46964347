"""A thread for writing files, so that the steps do not wait for the disk."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

WAITING = 100  # largest number of records in memory; with more the run waits for the disk


class Writer:
    """Queue of tasks for one thread, executed in order; after an error no further ones.

    Tasks must not communicate with other ranks.

    Attributes
    ----------
    error : Exception or None
        The first error.
    """

    def __init__(self) -> None:
        self._queue: queue.Queue[Callable[[], None] | None] = queue.Queue(WAITING)
        self.error: Exception | None = None
        # A daemon: a run that ends at once does not wait for a disk that hangs.
        self._thread = threading.Thread(target=self._work, name="writer", daemon=True)
        self._thread.start()

    def submit(self, action: Callable[[], None]) -> None:
        """Add a task; waits while too many are in the queue."""
        self._queue.put(action)

    def drain(self) -> None:
        """Wait until all tasks are finished."""
        self._queue.join()

    def close(self) -> None:
        """Finish the remaining tasks, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (action := self._queue.get()) is not None:
            try:
                if self.error is None:
                    action()
            except Exception as error:
                self.error = error
            finally:
                self._queue.task_done()
        self._queue.task_done()
