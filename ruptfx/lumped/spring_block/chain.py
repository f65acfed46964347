"""Time integration of the chain: explicit, with exact times of contact failure and reattachment.

Every block is a mass on springs to its neighbours and on breakable springs, the contacts, to the rigid base. A
contact force is not needed: a contact breaks where its block passes x_0 +- f_s / k, so that a step costs one
matrix-vector product and two comparisons per block, and contacts are updated only when one breaks or reattaches.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Chain:
    """Constants of the chain, all forces in N, stiffnesses in N/m.

    Attributes
    ----------
    mass, damping : float
        Mass of a block [kg]; damping rate against the base [1/s].
    spring : float
        Stiffness between neighbouring blocks, K_b.
    drive_stiffness, drive_speed : float
        Loading spring K_d at block 0 and its speed [m/s].
    contacts : ndarray of int, shape (blocks,)
        Number of contacts of each block.
    contact_stiffness, contact_strength, scatter : float
        Means of k and f_s of a contact; relative standard deviation of f_s.
    delay : float
        Time from breaking to reattachment [s].
    ageing, ageing_time : float
        Threshold f_s (1 + ageing ln(1 + age / ageing_time)).
    """

    mass: float
    damping: float
    spring: float
    drive_stiffness: float
    drive_speed: float
    contacts: np.ndarray
    contact_stiffness: float
    contact_strength: float
    scatter: float
    delay: float
    ageing: float = 0.0
    ageing_time: float = 1.0

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return len(self.contacts)

    def stiffness_matrix(self) -> np.ndarray:
        """Return the stiffness of the springs between blocks and the loading spring, shape (blocks, blocks)."""
        n = self.blocks
        coupling = np.diag(np.full(n, 2.0)) - np.eye(n, k=1) - np.eye(n, k=-1)
        if n:
            coupling[0, 0] -= 1
            coupling[-1, -1] -= 1
        matrix = self.spring * coupling
        matrix[0, 0] += self.drive_stiffness
        return matrix

    def stable_step(self) -> float:
        """Return the largest stable time step 2 / omega_max [s]; Gershgorin bounds omega_max^2."""
        stiffest = 4 * self.spring + self.drive_stiffness + self.contact_stiffness * self.contacts.max() * 1.1
        return 2 / np.sqrt(stiffest / self.mass)


@dataclass
class Contacts:
    """State of all contacts, shape (blocks, most contacts per block); unused entries never attach."""

    chain: Chain
    random: np.random.Generator
    origin: np.ndarray = field(init=False)  # block position at which a contact is unstretched [m]
    stiffness: np.ndarray = field(init=False)  # 0 while detached
    strength: np.ndarray = field(init=False)
    since: np.ndarray = field(init=False)  # time of attachment [s]

    def __post_init__(self) -> None:
        shape = (self.chain.blocks, int(self.chain.contacts.max()))
        self.origin, self.since = np.zeros(shape), np.zeros(shape)
        self.strength, self.stiffness = self.draw(shape)
        self.stiffness[np.arange(shape[1]) >= self.chain.contacts[:, None]] = 0.0

    def draw(self, size: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Draw Gaussian thresholds [N] and stiffnesses k = <k> sqrt(f_s / <f_s>) [N/m], both of shape `size`."""
        ratio = np.maximum(1 + self.chain.scatter * self.random.standard_normal(size), 1e-3)
        return self.chain.contact_strength * ratio, self.chain.contact_stiffness * np.sqrt(ratio)

    def reach(self, row: int | slice, time: float) -> np.ndarray:
        """Return the stretch [m] at which contacts break."""
        strength = self.strength[row]
        if self.chain.ageing:
            age = np.maximum(time - self.since[row], 0.0)
            strength = strength * (1 + self.chain.ageing * np.log1p(age / self.chain.ageing_time))
        with np.errstate(divide="ignore"):
            return np.where(self.stiffness[row] > 0, strength / self.stiffness[row], np.inf)

    def bounds(self, row: int | slice, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions [m] below and above which the first contact of a block breaks, one for each block."""
        reach = self.reach(row, time)
        return (self.origin[row] - reach).max(axis=-1), (self.origin[row] + reach).min(axis=-1)


@dataclass
class History:
    """Recorded data of a run: samples in time, and every breaking of contacts.

    Attributes
    ----------
    time, force : list of float
        Sampled time [s] and loading force [N].
    position, attached, contact_force : list of ndarray, shape (blocks,)
        At the sampled times: position [m], attached fraction, mean force of a block's contacts [N].
    break_time, break_block, break_count : list
        Time, block and number of broken contacts, for every step and block with broken ones.
    first_force : float
        Loading force at the first breaking [N].
    """

    time: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    position: list[np.ndarray] = field(default_factory=list)
    attached: list[np.ndarray] = field(default_factory=list)
    contact_force: list[np.ndarray] = field(default_factory=list)
    break_time: list[float] = field(default_factory=list)
    break_block: list[int] = field(default_factory=list)
    break_count: list[int] = field(default_factory=list)
    first_force: float = np.nan


class Integrator:
    """Central differences x(t + dt) = A x(t) - B x(t - dt) + c, with events after every step.

    With the damping centred too, (1 + h) x+ = 2 x - (1 - h) x- + dt^2 (f - K x) / m, h = eta dt / 2.
    """

    def __init__(self, chain: Chain, dt: float, seed: int) -> None:
        self.chain, self.dt = chain, dt
        self.contacts = Contacts(chain, np.random.default_rng(seed))
        self.time = 0.0
        half = chain.damping * dt / 2
        self.scale = dt**2 / chain.mass / (1 + half)
        self.previous = (1 - half) / (1 + half)
        stiffness = chain.stiffness_matrix() + np.diag(self.contacts.stiffness.sum(axis=1))
        self.matrix = 2 / (1 + half) * np.eye(chain.blocks) - self.scale * stiffness
        # scale * (force of stretched contacts' origins); row 0 also carries the moving end of the loading spring.
        self.source = np.zeros(chain.blocks)
        self.drive = self.scale * chain.drive_stiffness * chain.drive_speed * dt
        self.x, self.x_old = np.zeros(chain.blocks), np.zeros(chain.blocks)
        self.low, self.high = self.contacts.bounds(slice(None), 0.0)
        self.returning: deque[tuple[float, int, np.ndarray]] = deque()
        self.steps = 0

    @property
    def force(self) -> float:
        """Loading force F = K_d (V_d t - x_0) [N]."""
        return self.chain.drive_stiffness * (self.chain.drive_speed * self.time - self.x[0])

    def advance(self, steps: int, history: History) -> None:
        """Take time steps, with breaking and reattachment of contacts."""
        x, old, matrix, source = self.x, self.x_old, self.matrix, self.source
        new, outside, back = np.empty_like(x), np.empty(len(x), bool), np.empty(len(x), bool)
        low, high, previous, drive, dt = self.low, self.high, self.previous, self.drive, self.dt
        for _ in range(steps):
            np.dot(matrix, x, out=new)
            np.multiply(old, previous, out=old)
            np.subtract(new, old, out=new)
            np.add(new, source, out=new)
            source[0] += drive
            x, old, new = new, x, old
            self.steps += 1
            np.greater(x, high, out=outside)
            np.less(x, low, out=back)
            np.logical_or(outside, back, out=outside)
            if outside.any():
                self.time = self.steps * dt
                self._break(np.flatnonzero(outside), x, history)
            if self.returning and self.returning[0][0] <= self.steps * dt:
                self.time = self.steps * dt
                self._return(x)
        self.time = self.steps * dt
        self.x, self.x_old = x, old

    def _break(self, rows: np.ndarray, x: np.ndarray, history: History) -> None:
        contacts = self.contacts
        for row in rows:
            stretch = np.abs(x[row] - contacts.origin[row])
            broken = np.flatnonzero(stretch > contacts.reach(row, self.time))
            if len(broken):
                self._couple(row, broken, -1.0)
                contacts.stiffness[row, broken] = 0.0
                if not history.break_time:
                    history.first_force = self.chain.drive_stiffness * (self.chain.drive_speed * self.time - x[0])
                self.returning.append((self.time + self.chain.delay, int(row), broken))
                history.break_time.append(self.time)
                history.break_block.append(int(row))
                history.break_count.append(len(broken))
            self.low[row], self.high[row] = contacts.bounds(row, self.time)

    def _return(self, x: np.ndarray) -> None:
        contacts = self.contacts
        while self.returning and self.returning[0][0] <= self.time:
            _, row, places = self.returning.popleft()
            strength, stiffness = contacts.draw((len(places),))
            contacts.strength[row, places], contacts.stiffness[row, places] = strength, stiffness
            contacts.origin[row, places], contacts.since[row, places] = x[row], self.time
            self._couple(row, places, 1.0)
            self.low[row], self.high[row] = contacts.bounds(row, self.time)

    def _couple(self, row: int, places: np.ndarray, sign: float) -> None:
        """Add contacts to the stiffness and source of the block, or remove them."""
        stiffness = self.contacts.stiffness[row, places]
        self.matrix[row, row] -= sign * self.scale * stiffness.sum()
        self.source[row] += sign * self.scale * (stiffness * self.contacts.origin[row, places]).sum()

    def sample(self, history: History) -> None:
        """Append a sample to the history."""
        contacts = self.contacts
        history.time.append(self.time)
        history.force.append(self.force)
        history.position.append(self.x.copy())
        history.attached.append((contacts.stiffness > 0).sum(axis=1) / self.chain.contacts)
        pulled = (contacts.stiffness * (self.x[:, None] - contacts.origin)).sum(axis=1)
        history.contact_force.append(pulled / self.chain.contacts)
        if self.chain.ageing:  # thresholds grew since the last sample
            self.low[:], self.high[:] = contacts.bounds(slice(None), self.time)
