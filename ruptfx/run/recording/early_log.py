"""Lines for the log of a run from before it is open: those of the model and of the binding of its stepper."""

from __future__ import annotations

import logging

from ruptfx.platform.progress import note

LOG = logging.getLogger("ruptfx.run")


class EarlyLog(logging.Handler):
    """Collect the lines of a run within a context; `write_to` copies them to its log.

    Parameters
    ----------
    is_root : bool
        True on rank 0; other ranks collect nothing.

    Attributes
    ----------
    lines : list of (int, str)
        Levels and texts.
    """

    def __init__(self, is_root: bool) -> None:
        super().__init__(logging.INFO)
        self.lines: list[tuple[int, str]] = []
        self._is_root, self._level_before = is_root, LOG.level

    def emit(self, record: logging.LogRecord) -> None:
        """Collect a line."""
        self.lines.append((record.levelno, record.getMessage()))

    def __enter__(self) -> EarlyLog:
        self._level_before = LOG.level
        if self._is_root:
            LOG.addHandler(self)
            LOG.setLevel(logging.INFO)
        return self

    def __exit__(self, *_: object) -> None:
        LOG.removeHandler(self)
        LOG.setLevel(self._level_before)

    def show(self, progress: bool) -> None:
        """Print the lines beside the progress; without progress the warnings alone."""
        for level, text in self.lines:
            note(text, progress or level >= logging.WARNING)

    def write_to(self, log: logging.Logger) -> None:
        """Write the lines to the log of the run."""
        for level, text in self.lines:
            log.log(level, "%s", text)
