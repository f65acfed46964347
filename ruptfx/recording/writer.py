"""A thread that writes, so that the steps do not wait."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

WAITING = 100  # records of an interface that may wait; more, and the run waits for the disk


class Writer:
    """Does what it is given, one thing after the other; after an error nothing more.

    It must be given nothing that talks to other ranks.

    Attributes
    ----------
    error : Exception or None
        The first one.
    """

    def __init__(self) -> None:
        self._queue: queue.Queue[Callable[[], None] | None] = queue.Queue(WAITING)
        self.error: Exception | None = None
        # A daemon: a run that ends at once does not wait for a disk that hangs.
        self._thread = threading.Thread(target=self._work, name="writer", daemon=True)
        self._thread.start()

    def submit(self, action: Callable[[], None]) -> None:
        """Do this soon; waits while too much else does."""
        self._queue.put(action)

    def drain(self) -> None:
        """Wait until all is done."""
        self._queue.join()

    def close(self) -> None:
        """Do what is left, and end."""
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
