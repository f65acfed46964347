"""Time of a run by phase, by the clock and without gaps: model, steps, energies, gathering, writing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

_seconds: dict[str, float] = {}
_phase, _since = "start", time.perf_counter()


def restart() -> None:
    """Forget what was before."""
    global _phase, _since
    _seconds.clear()
    _phase, _since = "start", time.perf_counter()


def _turn_to(name: str) -> str:
    """Begin a phase; the name of the one that it ends."""
    global _phase, _since
    before, now = _phase, time.perf_counter()
    _seconds[before] = _seconds.get(before, 0.0) + now - _since
    _phase, _since = name, now
    return before


@contextmanager
def phase(name: str) -> Iterator[None]:
    """Count what happens inside for this phase and not for the one around it; for the main thread."""
    before = _turn_to(name)
    try:
        yield
    finally:
        _turn_to(before)


def phases() -> dict[str, float]:
    """Seconds since `restart` by phase; what is in none of them is of the phase `start`."""
    _turn_to(_phase)
    return dict(_seconds)
