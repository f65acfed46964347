"""Processor time of a run by phase, without gaps: start, model, steps, energies, gathering, writing, end, figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

_seconds: dict[str, float] = {}
_phase, _since = "start", 0.0  # time before the first phase counts as start


def _turn_to(name: str) -> str:
    """Begin a phase; the name of the one that it ends."""
    global _phase, _since
    before, now = _phase, time.thread_time()
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
    """Processor time of this process so far [s], by phase; other threads than the main one write."""
    _turn_to(_phase)
    others = time.process_time() - time.thread_time()
    return {**_seconds, "writing": _seconds.get("writing", 0.0) + others}
