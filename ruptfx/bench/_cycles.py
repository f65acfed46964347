"""Ruptures in a history of slip rates along a fault, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

BEGINS, ENDS = 1e-3, 1e-4  # m/s, of the largest slip rate


@dataclass
class Event:
    """One rupture: its first step, where [m] and when [s] it begins, and what comes of it."""

    onset: float
    depth: float
    nucleation: float
    """Length of the zone it grew from [m]: what slides at a tenth of the largest slip rate or more."""
    first_step: int
    peak: float = 0.0
    """Largest slip rate [m/s]."""
    slip: float = 0.0
    """Largest slip [m]; zero before the end."""


@dataclass
class Cycles:
    """What a run leaves: its events, and of every step time [s] and largest slip rate [m/s].

    Attributes
    ----------
    position : ndarray, shape (n,)
        Of the points of the fault [m].
    """

    position: np.ndarray
    events: list[Event] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    _slip: np.ndarray | None = None

    def look(self, time: float, rate: np.ndarray, slip: np.ndarray) -> None:
        """At the end of a step: slip rate [m/s] and slip [m] of every point."""
        fastest = float(rate.max())
        self.times.append(time)
        self.speeds.append(fastest)
        if self._slip is None and fastest > BEGINS:
            zone = self.position[rate > 0.1 * fastest]
            depth = float(self.position[np.argmax(rate)])
            self.events.append(Event(time, depth, float(np.ptp(zone)), len(self.times)))
            self._slip = slip.copy()
        if self._slip is not None:
            event = self.events[-1]
            event.peak = max(event.peak, fastest)
            if fastest < ENDS:
                event.slip, self._slip = float((slip - self._slip).max()), None

    @property
    def over(self) -> int:
        """Events that have ended."""
        return len(self.events) - (self._slip is not None)

    @property
    def intervals(self) -> np.ndarray:
        """Between the onsets [s]."""
        return np.diff([event.onset for event in self.events])
