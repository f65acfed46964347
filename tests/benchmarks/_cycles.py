"""Ruptures in a history of slip rates along a fault, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

BEGINS, ENDS = 1e-3, 1e-4  # m/s: an event begins and ends when the largest slip rate passes these
SLOW, FAST = 5 * 365.25 * 24 * 3600, 1.0  # s between saved slip profiles: outside and inside a rupture


@dataclass
class Event:
    """One rupture: its first step, the place [m] and time [s] of its onset, and its results."""

    onset: float
    depth: float
    nucleation: float
    """Length of the nucleation zone [m]: points that slip at a tenth of the largest slip rate or faster."""
    first_step: int
    peak: float = 0.0
    """Largest slip rate [m/s]."""
    slip: float = 0.0
    """Largest slip [m]; zero before the end."""
    first_slip: float = 0.0
    """Slip of the first point, at the surface [m]; zero before the end."""


@dataclass(frozen=True)
class Profile:
    """Slip along the fault [m], at a time [s], in a rupture or not."""

    time: float
    slip: np.ndarray
    ruptures: bool


@dataclass
class Cycles:
    """Events of a run, time [s] and largest slip rate [m/s] of every step, and slip profiles.

    Attributes
    ----------
    position : ndarray, shape (n,)
        Depth of the fault points [m].
    """

    position: np.ndarray
    events: list[Event] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    profiles: list[Profile] = field(default_factory=list)
    _slip: np.ndarray | None = None

    def look(self, time: float, rate: np.ndarray, slip: np.ndarray) -> None:
        """Add the end of a step: slip rate [m/s] and slip [m] of every point."""
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
                slipped = slip - self._slip
                event.slip, event.first_slip, self._slip = float(slipped.max()), float(slipped[0]), None
        ruptures = self._slip is not None
        last = self.profiles[-1] if self.profiles else Profile(-np.inf, slip, False)
        if ruptures != last.ruptures or time - last.time >= (FAST if ruptures else SLOW):
            self.profiles.append(Profile(time, slip.copy(), ruptures))

    @property
    def over(self) -> int:
        """Number of events that have ended."""
        return len(self.events) - (self._slip is not None)

    @property
    def intervals(self) -> np.ndarray:
        """Times between the onsets [s]."""
        return np.diff([event.onset for event in self.events])
