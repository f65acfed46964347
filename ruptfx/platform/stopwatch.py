"""Wall-clock time of a run by phase, without gaps: model, steps, energies, gathering, writing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

_seconds: dict[str, float] = {}
_phase, _since = "start", time.perf_counter()


def restart() -> None:
    """Reset all times."""
    global _phase, _since
    _seconds.clear()
    _phase, _since = "start", time.perf_counter()


def _turn_to(name: str) -> str:
    """Start a phase; return the name of the previous one."""
    global _phase, _since
    before, now = _phase, time.perf_counter()
    _seconds[before] = _seconds.get(before, 0.0) + now - _since
    _phase, _since = name, now
    return before


@contextmanager
def phase(name: str) -> Iterator[None]:
    """Count the time inside the context for this phase, not for the enclosing one; main thread only."""
    before = _turn_to(name)
    try:
        yield
    finally:
        _turn_to(before)


def phases() -> dict[str, float]:
    """Return the seconds since `restart` by phase; time outside of all phases belongs to `start`."""
    _turn_to(_phase)
    return dict(_seconds)
