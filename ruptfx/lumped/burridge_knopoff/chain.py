"""One event of the chain: slipping blocks, their slip, and the dissipated energy.

Lengths are divided by D = strength / leaf stiffness, times by sqrt(mass / leaf stiffness), forces by the strength. In
these units, with u the displacement of a block ahead of its drive,

    u'' = l^2 (u_right - 2 u + u_left) - u - phi(u'),    phi(v) = (1 - sigma) / (1 + 2 alpha v / (1 - sigma)),

where a block sticks while the force does not exceed 1, and never slips back. The drive does not move during an event.
Source: Carlson and Langer (1989), Phys. Rev. A 40, 6470; the drop sigma is that of Carlson, Langer, Shaw and Tang
(1991), Phys. Rev. A 44, 884.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx import RuptfxError

_MOST_STEPS = 1_000_000


@dataclass(frozen=True)
class Chain:
    """Constants of a chain.

    Attributes
    ----------
    coupling : float
        l^2, stiffness of the springs between blocks over that of the leaf springs.
    drop : float
        sigma, fall of the friction when a block begins to slip.
    weakening : float
        alpha, rate of the decrease of friction with the slip rate.
    """

    coupling: float
    drop: float
    weakening: float

    def spring_force(self, u: np.ndarray) -> np.ndarray:
        """Return the force of all springs on every block; the ends of the chain are free."""
        force = -u
        pull = self.coupling * np.diff(u)
        force[:-1] += pull
        force[1:] -= pull
        return force

    def stable_step(self) -> float:
        """Return 2 / omega of the fastest mode, in which neighbours move in opposite directions."""
        return 2 / float(np.sqrt(1 + 4 * self.coupling))

    def slide(self, velocity: np.ndarray, force: np.ndarray, dt: float) -> np.ndarray:
        """Return the velocity of every block after a step of sliding with implicit friction; 0 where it stops.

        v + dt phi(v) = velocity + dt force is a quadratic equation; of two roots the faster one is stable.
        """
        level, rate = 1 - self.drop, 2 * self.weakening / (1 - self.drop)
        pushed = velocity + dt * force
        if rate == 0:
            return np.maximum(pushed - dt * level, 0.0)
        half = 0.5 * (rate * pushed - 1)
        root = half**2 + rate * (pushed - dt * level)
        return np.where(root >= 0, np.maximum(half + np.sqrt(np.maximum(root, 0.0)), 0.0) / rate, 0.0)


@dataclass(frozen=True)
class Event:
    """Result of an event.

    Attributes
    ----------
    slip : ndarray, shape (blocks,)
    duration : float
    released, dissipated : float
        Energy released by the springs, and energy dissipated by friction.
    """

    slip: np.ndarray
    duration: float
    released: float
    dissipated: float


def load(chain: Chain, u: np.ndarray) -> float:
    """Move the drive until the first block is about to slip; return the distance."""
    distance = 1 - float(chain.spring_force(u).max())
    u -= distance
    return distance


def slip_event(chain: Chain, u: np.ndarray, dt: float) -> Event:
    """Run one event until every block sticks; update `u` in place.

    The time step is that of leapfrog: released and dissipated energy agree to round-off at any step size.

    Raises
    ------
    RuptfxError
        If the event does not end.
    """
    before, start = u.copy(), -0.5 * float(u @ chain.spring_force(u))
    velocity, dissipated = np.zeros_like(u), 0.0
    sliding = np.zeros(len(u), dtype=bool)
    for step in range(_MOST_STEPS):
        force = chain.spring_force(u)
        sliding |= force > 1
        if step == 0:
            sliding[np.argmax(force)] = True
        if not sliding.any():
            end = -0.5 * float(u @ chain.spring_force(u))
            return Event(u - before, step * dt, start - end, dissipated)
        after = np.where(sliding, chain.slide(velocity, force, dt), 0.0)
        friction = force - (after - velocity) / dt
        dissipated += 0.5 * dt * float(friction @ (after + velocity))
        sliding, velocity = after > 0, after
        u += dt * velocity
    raise RuptfxError(f"an event has not ended after {_MOST_STEPS} steps; increase drop, or decrease weakening")
