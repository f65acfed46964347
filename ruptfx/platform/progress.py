"""Progress display: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import os
from types import TracebackType

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ruptfx.platform.terminal import console


class Progress:
    """A bar on a terminal, a line every tenth of the work elsewhere; a context manager.

    Parameters
    ----------
    show : bool
    """

    def __init__(self, show: bool = True) -> None:
        # Under mpiexec the terminal of the launcher counts; `ruptfx run` sets the variable.
        terminal = True if os.environ.get("RUPTFX_TERMINAL") else None
        self._console = console(force_terminal=terminal, stderr=True)
        self._show, self._tenth = show, 0
        self._bar: Bar | None = None
        if show and self._console.is_terminal:
            self._bar = Bar(
                TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
                TimeElapsedColumn(), TimeRemainingColumn(), console=self._console,
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
        text : str
        """
        done = min(fraction, 1.0)  # the last step of a run may exceed its duration
        tenth = int(10 * done)
        if self._bar:
            self._bar.update(self._task, completed=done, description=text)
        elif self._show and tenth > self._tenth:
            self._console.print(f"{10 * tenth:3d} %  {text}")
        self._tenth = tenth

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar:
            self._bar.stop()
