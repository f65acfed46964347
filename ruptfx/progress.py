"""One progress line for a long run: simulated time, step, peak slip rate, time left."""

from __future__ import annotations

import os
from typing import Any

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ruptfx.terminal import console


class Progress:
    """A bar on a terminal, a line every tenth of the run elsewhere.

    Parameters
    ----------
    duration : float
        Simulated time of the whole run [s].
    show : bool
    """

    def __init__(self, duration: float, show: bool) -> None:
        # Under mpiexec the launcher's terminal is what counts; `ruptfx run` passes its nature on.
        terminal = True if os.environ.get("RUPTFX_TERMINAL") else None
        self._console = console(force_terminal=terminal, stderr=True)
        self._duration, self._show, self._tenth = duration, show, 0
        self._bar: Bar | None = None
        if show and self._console.is_terminal:
            self._bar = Bar(
                TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
                TimeRemainingColumn(),
                console=self._console, transient=False,
            )  # fmt: skip
            self._task = self._bar.add_task(self._text(0.0, 0, 0.0), total=duration)

    def _text(self, time: float, step: int, peak: float) -> str:
        return f"t = {time:9.3g} s of {self._duration:.3g}  step {step:6d}  peak slip rate {peak:8.3g} m/s"

    def __enter__(self) -> Progress:
        if self._bar:
            self._bar.start()
        return self

    def update(self, time: float, step: int, peak: float) -> None:
        """Show where the run is.

        Parameters
        ----------
        time : float
            Simulated time [s].
        step : int
        peak : float
            Largest slip rate now [m/s].
        """
        if not self._show:
            return
        text = self._text(time, step, peak)
        done = min(time / self._duration, 1.0)  # the last step may pass the end
        if self._bar:
            self._bar.update(self._task, completed=done * self._duration, description=text)
        elif int(10 * done) > self._tenth:
            self._tenth = int(10 * done)
            self._console.print(f"{10 * self._tenth:3d} %  {text}")

    def __exit__(self, *_: Any) -> None:
        if self._bar:
            self._bar.stop()
