"""Rates as functions of the displacement, and the equilibrium found by an implicit step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms import ImplicitForce, Reaction, StepEnd
    from ruptfx.interfaces.sliding.follower import StepFollower
    from ruptfx.stepping.implicit.response import FaultResponse


@dataclass(frozen=True)
class Rates:
    """Velocity and acceleration as functions of the unknown displacement u.

    Attributes
    ----------
    mass : float
        c_M in a = c_M (u - displacement) [1/s2].
    damping : float
        c_C in v = velocity + c_C (u - displacement) [1/s].
    displacement, velocity : ndarray, shape (nodes * components,)
        Predictors [m], [m/s].
    weights : (float, float, float, float), optional
        alpha_m, alpha_f, gamma and beta of generalized-alpha, for unknowns besides those of the bodies.
    """

    mass: float
    damping: float
    displacement: np.ndarray
    velocity: np.ndarray
    weights: tuple[float, float, float, float] | None = None

    def acceleration_of(self, u: np.ndarray) -> np.ndarray:
        return np.asarray(self.mass * (u - self.displacement))

    def velocity_of(self, u: np.ndarray) -> np.ndarray:
        return np.asarray(self.velocity + self.damping * (u - self.displacement))


@dataclass
class Solution:
    """An equilibrium, not yet part of the state.

    Attributes
    ----------
    displacement : ndarray, shape (nodes * components,)
        Displacement at the end of the step [m], complete at ghosts.
    internal : ndarray, shape (nodes * components,)
        K u + J' W (T - T_0) [N] at every local node: internal force of bodies and interfaces.
    faults : dict of str to FaultState
        New fault fields.
    dt : float
        Length of the step [s].
    iterations, outer : int
        Newton iterations in all, and outer ones of the multipliers (1 without).
    residuals : list of float
        Norm of R after every Newton iteration [N].
    scale : float
        Norm of the largest of the forces that balance [N].
    tangents : dict of str to ndarray, shape (n, local, local)
        dT / d[u] by fault [Pa/m], of `Equilibrium.answer`.
    begun : ndarray, shape (nodes * components,), optional
        K u + J' W (T - T_0) at the beginning [N] with the pairing of that time, for finite sliding.
    pairing_changes : list of float
        Relative change of the pressure by each update of the pairing (`StepFollower.change`);
        empty without finite sliding.
    slid : float
        Largest slip of the step over its limit, on sliding interfaces.
    followers : list of StepFollower
        Followers of the sliding interfaces.
    reactions : list of (ImplicitForce, StepEnd, Reaction)
        Other mechanisms with their forces.
    """

    displacement: np.ndarray
    internal: np.ndarray
    faults: dict[str, FaultState]
    dt: float
    iterations: int
    outer: int
    residuals: list[float]
    scale: float
    _answers: Mapping[str, FaultResponse] = field(repr=False, default_factory=dict)
    tangents: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    begun: np.ndarray | None = None
    pairing_changes: list[float] = field(default_factory=list)
    slid: float = 0.0
    followers: list[StepFollower] = field(repr=False, default_factory=list)
    reactions: list[tuple[ImplicitForce, StepEnd, Reaction]] = field(repr=False, default_factory=list)

    def commit(self, state: State) -> None:
        """Copy the solution to the state; arrays of the state keep their memory."""
        for mechanism, end, reaction in self.reactions:
            mechanism.advance(state, end, reaction)
        moved = self.displacement - state.displacement
        state.displacement[:] = self.displacement
        state.time += self.dt
        state.step += 1
        state.numbers["dt_before"] = self.dt
        entries = {name: answer.commit(state, self.faults[name], self.dt) for name, answer in self._answers.items()}
        for follower in self.followers:
            follower.commit(state, moved, sum(entries[follower.name]))
