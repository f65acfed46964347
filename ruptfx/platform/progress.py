"""Progress display: a spinner or a bar with the time left on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ruptfx.platform.terminal import console

_in_lines: ContextVar[bool] = ContextVar("_in_lines", default=False)


def in_lines() -> bool:
    """Return whether the current phase was named by a line, so that its parts are named by lines as well."""
    return _in_lines.get()


@contextmanager
def working(on: str, show: bool = True) -> Iterator[None]:
    """Name a phase of unknown length: a spinner with a clock on a terminal, elsewhere one line.

    Parameters
    ----------
    on : str
        What is being done, such as "building the model".
    """
    screen = _console()
    if not (show and screen.is_terminal):
        if show:
            screen.print(on)
        token = _in_lines.set(show)
        try:
            yield
        finally:
            _in_lines.reset(token)
        return
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    with Bar(*columns, console=screen, transient=True) as spinner:
        spinner.add_task(on, total=None)
        yield


def note(text: str, show: bool = True) -> None:
    """Print a line beside the progress, on standard error."""
    if show:
        _console().print(text, soft_wrap=True, markup=False)


def _console() -> Console:
    # Under mpiexec the terminal of the launcher counts; `ruptfx run` sets the variable.
    return console(force_terminal=True if os.environ.get("RUPTFX_TERMINAL") else None, stderr=True)


SILENCE = 600.0
"""Longest time without a line [s]."""
BESIDE = 28
"""Characters of a line of a terminal for the bar, the percentage and the time left."""


class Progress:
    """A bar on a terminal, elsewhere a line every tenth of the work and every ten minutes; a context manager."""

    def __init__(self, show: bool = True) -> None:
        self._console = _console()
        self._show, self._tenth = show, 0
        self._began, self._first = time.monotonic(), 0.0
        self._last = self._began  # time of the last line
        self._bar: Bar | None = None
        if show and self._console.is_terminal:
            self._bar = Bar(
                TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
                TextColumn("left"), TimeRemainingColumn(), console=self._console,
            )  # fmt: skip
            self._task = self._bar.add_task("", total=1.0)

    def __enter__(self) -> Progress:
        if self._bar:
            self._bar.start()
        return self

    def update(self, fraction: float, text: str) -> None:
        """Show the state of the work.

        Parameters
        ----------
        fraction : float
            Finished fraction of the work; may decrease when work is added.
        """
        done = min(fraction, 1.0)  # the last step of a run may exceed its duration
        tenth = int(10 * done)
        if self._bar:
            room = max(self._console.width - BESIDE, 1)
            text = text if len(text) <= room else f"{text[: room - 1]}…"
            self._bar.update(self._task, completed=done, description=text)
        elif self._show and (tenth > self._tenth or time.monotonic() - self._last > SILENCE):
            share = f"{10 * tenth:3d}" if tenth > self._tenth else f"{100 * done:3.0f}"
            day = "" if time.monotonic() - self._began < SILENCE else time.strftime("  at %H:%M")
            self._console.print(f"{share} %  {text}{self._left(done)}{day}", soft_wrap=True, markup=False)
            self._last = time.monotonic()
        self._tenth = tenth

    def _left(self, done: float) -> str:
        """Return the time left at the mean speed so far, where it is more than a few seconds."""
        seconds = (time.monotonic() - self._began) * (1 - done) / max(done - self._first, 1e-9)
        return f"  left {int(seconds) // 60}:{int(seconds) % 60:02d}" if 5 < seconds < 1e7 else ""

    def begin(self, fraction: float) -> None:
        """Start the clock of the time left at work that is partly finished: a resumed run."""
        self._began, self._first = time.monotonic(), fraction

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar:
            self._bar.stop()
